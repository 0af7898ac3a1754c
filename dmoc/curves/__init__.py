"""Time laws of a given path: trapezoids, blends, time-optimal scaling."""
