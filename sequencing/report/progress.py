"""What a person sees on stderr while a station is planned."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from sequencing.cycle.plan import PlanEvent

_PHASES = {
    "alternatives": "finding the alternatives of every stud",
    "estimates": "estimating the edges",
    "edges": "solving edges",
    "search": "searching the order",
    "final motions": "final motions, certified between the knots",
    "baseline": "comparison with sequences of least time",
    "polish": "turning the tools continuously",
    "done": "planned",
}


class ProgressText:
    """Collects events into the numbers of one line: edges, failures, best cycle, gap, left."""

    def __init__(self) -> None:
        self.phase = ""
        self.done = self.failed = self.left = self.reused = 0
        self.best: float | None = None
        self.gap: float | None = None

    def take(self, event: PlanEvent) -> None:
        """Update from an event; what it does not say stays."""
        # Edges are solved within every phase that follows; they keep that phase's name.
        if event.phase != "edges" or self.phase in ("", "alternatives", "estimates"):
            self.phase = event.phase
        if event.edges is not None:
            self.done, self.failed = event.edges.done, event.edges.failed
            self.left, self.reused = event.edges.left, event.edges.reused
        self.best = self.best if event.best is None else event.best
        self.gap = self.gap if event.gap is None else event.gap

    @property
    def title(self) -> str:
        """The phase in words."""
        return _PHASES.get(self.phase, self.phase)

    @property
    def numbers(self) -> str:
        """`edges 312 done, 4 failed, 20 left · from store 0 · best 1197.3 · gap 2.8 %`."""
        parts = [f"edges {self.done} done, {self.failed} failed, {self.left} left"]
        if self.reused:
            parts.append(f"{self.reused} from the store")
        if self.best is not None:
            parts.append(f"best {self.best:.1f}")
        if self.gap is not None and math.isfinite(self.gap):
            parts.append(f"conditional gap {100 * self.gap:.1f} %")
        return " · ".join(parts)


@contextmanager
def plan_progress(live: bool | None = None) -> Iterator[Callable[[PlanEvent], None]]:
    """A callback for `plan_station` that shows its events on stderr.

    On a terminal one line with a spinner, the numbers and a bar of the present batch; elsewhere a
    line whenever the phase or the best cycle changes. `live` overrides the choice.
    """
    text = ProgressText()
    if live if live is not None else sys.stderr.isatty():
        with _live(text) as callback:
            yield callback
        return
    last: tuple[str, float | None] = ("", None)

    def write(event: PlanEvent) -> None:
        nonlocal last
        text.take(event)
        now = (text.phase, text.best)
        if now != last:
            last = now
            sys.stderr.write(f"{text.title}: {text.numbers}\n")
            sys.stderr.flush()

    yield write


@contextmanager
def _live(text: ProgressText) -> Iterator[Callable[[PlanEvent], None]]:
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TextColumn("{task.fields[numbers]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None, numbers="")
        batch = 0

        def show(event: PlanEvent) -> None:
            nonlocal batch
            text.take(event)
            # A batch begins where more is left than before it.
            batch = max(batch, text.left) if text.left else 0
            bar.update(
                task,
                description=text.title,
                numbers=text.numbers,
                total=batch or None,
                completed=batch - text.left,
            )

        yield show
