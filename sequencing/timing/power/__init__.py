"""What robots draw along their paths, and what the DC link makes of it."""
