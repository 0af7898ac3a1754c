"""From a motion problem to a nonlinear programme: stage functions, rows, bounds, first guess."""
