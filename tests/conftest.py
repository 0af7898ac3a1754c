"""One worker a module whose tests share a fixture: two would each compute the same again."""

from __future__ import annotations

import pytest

PLANS = {"test_stud_welding_study", "test_cycle", "test_timing_schedule", "test_polish"}
"""Modules with a plan, a study or a schedule as their fixture, minutes together."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Groups of modules with fixtures of their own; the longest first, so that no worker idles."""
    for item in items:
        given = getattr(item, "_fixtureinfo").name2fixturedefs  # noqa: B009 (no public name)
        if any(d.scope == "module" for definitions in given.values() for d in definitions):
            item.add_marker(pytest.mark.xdist_group(item.path.stem))
    items.sort(key=lambda item: (item.path.stem not in PLANS, "regression" not in item.path.parts))
