"""Kept for importers: types in `planning.alternative`, search in `planning.alternatives_search`."""

from planning.alternative import Alternative, StudAlternatives, departure_knots
from planning.alternatives_search import alternatives

__all__ = ["Alternative", "StudAlternatives", "alternatives", "departure_knots"]
