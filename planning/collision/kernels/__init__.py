"""Compiled kernels on plain arrays: kinematics, convex distance, whole-scene queries."""
