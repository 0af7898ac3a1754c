"""Distances between a robot and its station, and the proof of clearance between knots."""
