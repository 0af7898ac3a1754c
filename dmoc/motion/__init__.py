"""What a motion is: the problem, the trajectory with its one interpolant, cost, status."""
