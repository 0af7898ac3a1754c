"""One worker a module whose fixtures plan: two would each plan the same again."""

from __future__ import annotations

import pytest

PLANS = {"test_stud_welding_study", "test_cycle", "test_timing_schedule", "test_polish"}
"""Modules with a plan, a study or a schedule as their fixture, minutes together."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Groups of those modules, first of all: the short tests fill up the other worker."""
    for item in items:
        if item.path.stem in PLANS:
            item.add_marker(pytest.mark.xdist_group(item.path.stem))
    items.sort(key=lambda item: item.path.stem not in PLANS)
