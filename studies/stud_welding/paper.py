"""The published figures that reports print beside ours."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any


def paper_tables() -> dict[str, Any]:
    """Tables 1 and 2 of the paper: `studs` as [number, alternatives, lowest, highest cost]."""
    path = resources.files("sequencing.report") / "templates" / "bjorkenstam_tables.json"
    return dict(json.loads(path.read_text(encoding="utf-8")))
