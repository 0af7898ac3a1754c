"""Faults of a cell file, collected with the place in the file that caused them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from dmoc.errors import DmocError, Fault
from dmoc.yaml_file import FieldPath, YamlTree, field_name
from planning.station_parts import Refuse

__all__ = ["CellFaults"]

T = TypeVar("T")


class CellFaults:
    """Collects faults; `refuse` and `attempt` name the field that they belong to."""

    def __init__(self, file: Path, tree: YamlTree) -> None:
        self.file, self.tree = file, tree
        self.folder = file.resolve().parent
        self.faults: list[Fault] = []

    def refuse(self, field: FieldPath) -> Refuse:
        def record(code: str, value: str, legal: str, fix: str, *more: str | int) -> None:
            place = (*field, *more)
            self.faults.append(
                Fault(code, file=str(self.file), line=self.tree.line(place),
                      field=field_name(place), value=value[:200], legal=legal, fix=fix)
            )  # fmt: skip

        return record

    def attempt(self, field: FieldPath, make: Callable[[], T]) -> T | None:
        """`make()`, or None with its faults recorded at `field`."""
        try:
            return make()
        except DmocError as error:
            for fault in error.faults:
                where = fault.file or str(self.file)
                line = fault.line if fault.file else self.tree.line(field)
                name = fault.field or field_name(field)
                self.faults.append(
                    Fault(fault.code, where, name, fault.value, fault.legal, fault.fix, line)
                )
            return None
