"""What a robot file may contain: every fault is named before any parser sees the file."""

from __future__ import annotations

from pathlib import Path

__all__ = ["check_urdf"]


def check_urdf(path: Path) -> None:
    """Raise `RobotError` with all faults of the URDF at `path`."""
