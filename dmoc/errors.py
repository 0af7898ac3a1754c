"""Errors for bad input. Expected failure of a computation is a `Status`, never an exception.

Every `DmocError` carries a stable code and names where the fault is (file, line, field), what the
value was, what is legal and how to fix it; the command prints exactly these, and `--json` returns
them as objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Self


@dataclass(frozen=True)
class Fault:
    """One fault in an input.

    `code` is stable, kebab-case (`mesh-missing`, `limit-inverted`); `field` is a path such as
    `obstacles[2].mesh`; `value`, `legal` and `fix` are sentences or literals for a person.
    """

    code: str
    file: str = ""
    field: str = ""
    value: str = ""
    legal: str = ""
    fix: str = ""
    line: int | None = None

    def __str__(self) -> str:
        where = self.file + (f":{self.line}" if self.line is not None else "")
        head = " ".join(part for part in (where, self.field) if part)
        text = f"[{self.code}] {head}" if head else f"[{self.code}]"
        if self.value:
            text += f": got {self.value}"
        if self.legal:
            text += f"; legal: {self.legal}"
        if self.fix:
            text += f"; fix: {self.fix}"
        return text

    def to_dict(self) -> dict[str, object]:
        """The object of the `errors` list in `--json` output."""
        return asdict(self)


class DmocError(Exception):
    """Bad input: one or several faults, all found at once."""

    def __init__(self, faults: Fault | Sequence[Fault]) -> None:
        self.faults: tuple[Fault, ...] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))

    @classmethod
    def of(
        cls,
        code: str,
        file: str = "",
        field: str = "",
        value: str = "",
        legal: str = "",
        fix: str = "",
        line: int | None = None,
    ) -> Self:
        """The error of one fault, see `Fault`."""
        return cls(Fault(code, file, field, value, legal, fix, line))

    def __reduce__(self) -> tuple[type[DmocError], tuple[tuple[Fault, ...]]]:
        return (type(self), (self.faults,))


class RobotError(DmocError):
    """A robot file (URDF or robot.yaml) cannot be used."""


class MeshError(DmocError):
    """A mesh cannot be used."""


class InputError(DmocError):
    """A station, cell, stud, GTSP or log file, or a command-line value, cannot be used."""


class ProblemError(DmocError):
    """A problem object built in Python is inconsistent (shapes, NaN, limits)."""
