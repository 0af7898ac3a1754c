"""Collision-free refinement: from a path to a certified optimal motion."""

from dmoc.refinement.loop import refine
from dmoc.refinement.params import RefineParams, RefineRecord

__all__ = ["RefineParams", "RefineRecord", "refine"]
