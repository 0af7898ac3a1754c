"""Timing of several robots on shared DC links: energy, collisions, schedules."""

from sequencing.timing.cell.read import Cell, load_cell
from sequencing.timing.scheduling import Schedule, run_schedule, schedule

__all__ = ["Cell", "Schedule", "load_cell", "run_schedule", "schedule"]
