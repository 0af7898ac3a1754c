"""Timing of several robots on shared DC links."""
