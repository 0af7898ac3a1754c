"""Solvers of a programme behind one registry, grids from coarse to fine, many problems at once."""
