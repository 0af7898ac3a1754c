"""Shapes and meshes: reading, checking, convex pieces, nearest points."""
