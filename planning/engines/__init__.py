"""Engines that measure one pair of convex pieces: coal and fcl behind one protocol."""
