"""Proven lower bounds of the cost of a travel (theory: docs/bounds.md)."""

from sequencing.bounds.travel import TravelBound, power_bound, travel_bound

__all__ = ["TravelBound", "power_bound", "travel_bound"]
