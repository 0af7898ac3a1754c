"""YAML with line numbers: a plain tree, and the line on which each field stands."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import yaml

from dmoc.arrays import MOST_BYTES
from dmoc.errors import DmocError, Fault, InputError


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
        raise InputError.of(
            "path-outside",
            file=file,
            field=field,
            value=problem,
            legal="a path relative to the file and inside its folder",
            fix="copy the file into the folder and name it there",
        )
    return path


def content_of(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """The bytes of a plain file; `OSError` for a pipe, a device, a folder or a larger file.

    A pipe is opened without waiting for whoever might write to it.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    try:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "not a plain file", str(path))
        if found.st_size > most_bytes:
            raise OSError(errno.EFBIG, f"{found.st_size} bytes, more than {most_bytes}", str(path))
        with os.fdopen(handle, "rb", closefd=False) as stream:
            return stream.read(most_bytes)
    finally:
        os.close(handle)


T = TypeVar("T")
FieldPath = tuple[str | int, ...]
_MOST_BYTES = 5_000_000
_MOST_DEPTH = 40


class _Loader(yaml.SafeLoader):
    """SafeLoader with the numbers and truth values of YAML 1.2; dates stay text.

    YAML 1.1 reads 010 as 8, 1:30 as 90, 1_3 as 13, `on` and `no` as truth values, 1e-6 as text.
    """


_INT = r"[-+]?(?:0|[1-9][0-9]*)"
_FLOAT = (
    r"[-+]?(?:(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?"
    r"|\.(?:inf|Inf|INF))|\.(?:nan|NaN|NAN)"
)
_KEPT = (":null", ":merge", ":value")
_Loader.yaml_implicit_resolvers = {
    key: [(tag, regexp) for tag, regexp in rows if tag.endswith(_KEPT)]
    for key, rows in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for _tag, _words, _first in (
    ("bool", "true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", _INT, "-+0123456789"),
    ("float", _FLOAT, "-+0123456789."),
):
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_words})$"), list(_first)
    )
_PLAIN_NUMBER = re.compile(f"(?:{_INT}|{_FLOAT})")
#: What another version of YAML takes for a number.
_OTHER_NUMBER = re.compile(
    r"[-+]?(?:0[xob][0-9a-f_]+|\.?[0-9][0-9_]*(?::[0-9_]+)*(?:\.[0-9_]*)?(?:e[-+]?[0-9_]+)?)",
    re.IGNORECASE,
)


def _is_ambiguous(node: yaml.ScalarNode) -> bool:
    """Whether versions of YAML read this scalar as different numbers, or as number and text."""
    if _PLAIN_NUMBER.fullmatch(node.value):
        return False
    tagged = node.tag.endswith((":int", ":float"))
    return tagged or (node.style is None and bool(_OTHER_NUMBER.fullmatch(node.value)))


class YamlTree:
    """`data` (plain lists, dicts, scalars) and `line(path)` of any field in it."""

    def __init__(self, data: Any, lines: dict[FieldPath, int]) -> None:
        self.data = data
        self._lines = lines

    def line(self, path: FieldPath) -> int | None:
        """Line (from 1) of the field, or of the nearest thing that holds it."""
        for size in range(len(path), -1, -1):
            if path[:size] in self._lines:
                return self._lines[path[:size]]
        return None


def field_name(path: FieldPath) -> str:
    """`("obstacles", 2, "mesh")` as `obstacles[2].mesh`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


class Refuse(Protocol):
    """Records a fault of a field (the last arguments lead further into it)."""

    def __call__(self, code: str, value: str, legal: str, fix: str, *more: str | int) -> None: ...


class InputFaults:
    """The faults of one file, collected so that none hides another, each with its line."""

    def __init__(self, file: Path, tree: YamlTree) -> None:
        self.file, self.tree = file, tree
        self.folder = file.resolve().parent
        self.faults: list[Fault] = []

    def refuse(self, field: FieldPath) -> Refuse:
        """A function that records a fault of `field`."""

        def record(code: str, value: str, legal: str, fix: str, *more: str | int) -> None:
            place = (*field, *more)
            self.faults.append(
                Fault(
                    code,
                    str(self.file),
                    field_name(place),
                    value[:200],
                    legal,
                    fix,
                    self.tree.line(place),
                )
            )

        return record

    def attempt(self, field: FieldPath, make: Callable[[], T]) -> T | None:
        """`make()`, or None with its faults recorded at `field`."""
        try:
            return make()
        except DmocError as error:
            for fault in error.faults:
                if fault.line is None and fault.file in ("", str(self.file)):
                    fault = replace(fault, file=str(self.file), line=self.tree.line(field))
                self.faults.append(replace(fault, field=fault.field or field_name(field)))
            return None


def read_yaml(path: Path, error_type: type[DmocError] = InputError) -> YamlTree:
    """Parse `path`; anchors, duplicate keys, deep nesting and bad syntax raise `error_type`."""

    def refuse(code: str, value: str, legal: str, fix: str, line: int | None = None) -> DmocError:
        return error_type(
            Fault(code, file=str(path), line=line, value=value[:200], legal=legal, fix=fix)
        )

    if not path.is_file():
        raise refuse("file-missing", str(path), "an existing file", "check the path")
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise refuse(
                "file-large",
                f"{path.stat().st_size} bytes",
                f"<= {_MOST_BYTES}",
                "keep geometry in mesh files",
            )
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise refuse("file-encoding", str(error), "UTF-8 text", "save it as UTF-8") from error
    except OSError as error:
        raise refuse("file-missing", str(error), "a readable file", "check its rights") from error
    try:
        _require_plain(text, refuse)
        node = yaml.compose(text, Loader=_Loader)
        lines: dict[FieldPath, int] = {}
        data = None if node is None else _build(_Loader(""), node, (), lines, refuse)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise refuse(
            "yaml-syntax",
            str(getattr(error, "problem", None) or error),
            "YAML",
            "mend the syntax of this line",
            None if mark is None else mark.line + 1,
        ) from error
    except ValueError as error:  # a number that Python refuses, such as one of 5000 digits
        raise refuse("yaml-syntax", str(error), "YAML", "mend the value") from error
    return YamlTree(data, lines)


def _require_plain(text: str, refuse: Any) -> None:
    """Refuse anchors (they can explode) and nesting that would exhaust the stack."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        line = None if event.start_mark is None else event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise refuse("yaml-anchor", "an anchor or alias", "plain YAML", "write it out", line)
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _MOST_DEPTH:
            raise refuse(
                "yaml-depth",
                f"more than {_MOST_DEPTH} levels",
                f"<= {_MOST_DEPTH} levels",
                "flatten it",
                line,
            )


def _build(
    loader: _Loader, node: yaml.Node, path: FieldPath, lines: dict[FieldPath, int], refuse: Any
) -> Any:
    lines[path] = node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        return [
            _build(loader, item, (*path, i), lines, refuse) for i, item in enumerate(node.value)
        ]
    if isinstance(node, yaml.MappingNode):
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, yaml.ScalarNode):
                raise refuse(
                    "yaml-key", "a list or mapping as key", "names as keys", "write a name", line
                )
            key = str(key_node.value)
            if key in result:
                raise refuse(
                    "yaml-duplicate",
                    field_name((*path, key)),
                    "each key once",
                    "remove one of them",
                    line,
                )
            result[key] = _build(loader, value_node, (*path, key), lines, refuse)
            lines[(*path, key)] = line
        return result
    if isinstance(node, yaml.ScalarNode) and _is_ambiguous(node):
        raise refuse(
            "yaml-number",
            f"{field_name(path)}: {node.value}",
            "decimal digits, a point, an exponent; no leading 0, no underscores or colons",
            "write the number in plain decimals, or in quotes if it is a name",
            lines[path],
        )
    return loader.construct_object(node)
