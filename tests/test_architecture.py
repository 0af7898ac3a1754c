"""The house: rooms say what lives in them, and a name means one thing."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("dmoc", "planning", "sequencing", "studies", "authoring")
SOURCES = {
    path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}
FOLDERS = sorted({Path(name).parent.as_posix() for name in SOURCES})


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_folder_begins_with_a_sentence(folder: str) -> None:
    tree = SOURCES.get(f"{folder}/__init__.py")
    assert tree is not None, "no __init__.py: the folder would be missing from the wheel"
    text = ast.get_docstring(tree) or ""
    first = text.split("\n\n")[0]
    assert first.endswith((".", "?")), first
    assert len(first.split()) >= 3, first


def test_every_module_says_what_it_is() -> None:
    silent = [name for name, tree in SOURCES.items() if not ast.get_docstring(tree)]
    assert silent == []


def test_no_module_is_named_like_a_function_in_it() -> None:
    """`from planning import alternatives` must not depend on what was imported before."""
    same = [
        name
        for name, tree in SOURCES.items()
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name == Path(name).stem
    ]
    assert same == []


def test_only_a_front_door_lists_its_names() -> None:
    listing = [
        name
        for name, tree in SOURCES.items()
        if not name.endswith("__init__.py")
        for node in ast.walk(tree)
        if isinstance(node, ast.Name) and node.id == "__all__"
    ]
    assert listing == []


def test_public_classes_have_names_of_their_own() -> None:
    places = defaultdict(list)
    for name, tree in SOURCES.items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(name)
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_git_ignores_no_source() -> None:
    """A pattern without a leading slash once hid a whole room from lint, wheel and commits."""
    patterns = [line for line in (ROOT / ".gitignore").read_text().split() if line.endswith("/")]
    ignored = {p.rstrip("/") for p in patterns if not p.startswith("/") and "/" not in p[:-1]}
    parts = {part for folder in FOLDERS for part in folder.split("/")}
    assert parts & ignored == set()
