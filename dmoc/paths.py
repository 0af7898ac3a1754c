"""Paths inside an input file: relative to it and confined to its folder."""

from __future__ import annotations

from pathlib import Path

from dmoc.errors import Fault, InputError

__all__ = ["confined"]


def confined(relative: str, folder: Path, file: str, field: str) -> Path:
    """`folder/relative`, resolved; `InputError` path-outside if it leaves `folder`."""
    problem = ""
    if not relative or "\x00" in relative or len(relative) > 1000:
        problem = "not a file name"
    else:
        try:
            root = folder.resolve()
            path = (root / relative).resolve()
            if not path.is_relative_to(root):
                problem = f"{relative} leads outside the folder"
        except (OSError, RuntimeError) as error:  # too long, or a loop of links
            problem = f"{relative[:80]}: {error}"
    if problem:
        raise InputError(
            Fault("path-outside", file=file, field=field, value=problem,
                  legal="a path relative to the file and inside its folder",
                  fix="copy the file into the folder and name it there")
        )  # fmt: skip
    return path
