"""One motion of one robot: dynamics, optimal control, refinement, drives."""
