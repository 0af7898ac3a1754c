"""Seed paths around obstacles, and the motion of one edge made from them."""
