"""Vysocký et al. (2020): Bézier motions of a UR3 that take less energy."""
