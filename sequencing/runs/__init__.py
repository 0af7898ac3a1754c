"""A run on disk: one author of result.json, the folder read back, one clock, two runs compared."""
