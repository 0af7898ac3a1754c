"""Björkenstam et al. (2014): sequencing of stud welds through optimal control."""
