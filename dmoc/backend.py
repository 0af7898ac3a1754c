"""Which form of a stage runs now: compiled if it is ready, the virtual machine until then."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from dmoc.codegen import Library, backend_mode, library_for
from dmoc.stages import Stage

__all__ = ["Backend", "StageSet"]

# Solves before a compiler is started in `auto`: one-off robots are not worth it.
SOLVES_BEFORE_COMPILING = 3


@dataclass
class StageSet:
    """The stages of one robot and cost and the state of their library in this process."""

    stages: tuple[Stage, ...]
    library: Library | None = None
    compiled: tuple[Stage, ...] | None = None
    uses: int = 0
    started: bool = False

    def current(self) -> Backend:
        """The stages to use for the next solve."""
        mode = backend_mode()
        if mode == "vm":
            return Backend("vm", self.stages)
        if self.compiled is None:
            self._advance(wait=mode == "c")
        if self.compiled is None:
            return Backend("vm", self.stages)
        return Backend("c", self.compiled)

    def _advance(self, wait: bool) -> None:
        self.uses += 1
        if self.library is None:
            self.library = library_for([part for stage in self.stages for part in stage.parts])
        if self._load():
            return
        if not self.started and (wait or self.uses > SOLVES_BEFORE_COMPILING):
            self.started = True
            self.library.start(wait)
            if wait:
                self._load()

    def _load(self) -> bool:
        functions = None if self.library is None else self.library.load()
        if functions is None:
            return False
        self.compiled = tuple(
            replace(stage, parts=_three(functions, 3 * i)) for i, stage in enumerate(self.stages)
        )
        return True


@dataclass(frozen=True)
class Backend:
    """`name` is `c` or `vm`; both give the same bits."""

    name: str
    stages: tuple[Stage, ...]


def _three(
    functions: tuple[ca.Function, ...], at: int
) -> tuple[ca.Function, ca.Function, ca.Function]:
    return functions[at], functions[at + 1], functions[at + 2]
