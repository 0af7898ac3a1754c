"""Equations of motion: continuous and discrete dynamics, states, and their re-simulation."""
