"""Which start delays and overrides: windows, orders, swarm and gradients."""
