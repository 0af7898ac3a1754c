"""Many motions: which ones, in what order, and when."""
