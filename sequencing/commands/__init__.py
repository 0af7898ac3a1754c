"""The commands of `dmoc`, one file each; all heavy imports happen inside them."""
