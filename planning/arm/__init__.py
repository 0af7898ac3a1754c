"""Inverse kinematics: closed forms and Newton's method, all branches of a pose."""
