"""Which Pythons are let in: said in one sentence by make, and resolved for the newest one."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NEXT = "3.14"


def requirements(version: str) -> list[str]:
    """Dependencies on a version; pip itself takes the markers of the Python that it runs on."""
    wanted = [Requirement(line) for line in PROJECT["dependencies"]]
    where = {"python_version": version, "python_full_version": f"{version}.0"}
    return [
        f"{item.name}{item.specifier}"
        for item in wanted
        if item.marker is None or item.marker.evaluate(where)
    ]


def test_ompl_is_asked_for_where_it_has_wheels_only() -> None:
    assert NEXT in SpecifierSet(PROJECT["requires-python"])
    assert "3.15" not in SpecifierSet(PROJECT["requires-python"])
    given = {version: any("ompl" in r for r in requirements(version)) for version in ("3.13", NEXT)}
    assert given == {"3.13": True, NEXT: False}


@pytest.mark.parametrize(("version", "runs"), [("3, 10", False), ("3, 12", True), ("3, 15", False)])
def test_make_says_in_one_sentence_that_a_python_does_not_do(version, runs, tmp_path) -> None:
    if shutil.which("make") is None:
        pytest.skip("make not found")
    false = tmp_path / "python"
    false.write_text(
        f'#!/bin/sh\n[ "$1" = -m ] && echo a venv is made && exit 0\n'
        f'exec {sys.executable} -c "import sys; sys.version_info = ({version}, 0); $2"\n'
    )
    false.chmod(0o755)
    venv = tmp_path / "venv"
    made = subprocess.run(
        ["make", "-C", ROOT, f"PYTHON={false}", f"VENV={venv}", f"{venv}/bin/python"],
        capture_output=True,
        text=True,
    )
    assert (made.returncode == 0) is runs
    assert ("a venv is made" in made.stdout) is runs
    named = version.replace(", ", ".")
    said = re.findall(r"^dmoc runs on Python 3\.11 to 3\.14, and .*", made.stderr, flags=re.M)
    assert len(said) == (0 if runs else 1)
    assert all(f"is {named}:" in line for line in said)


@pytest.mark.slow
def test_the_dependencies_have_wheels_for_the_newest_python(tmp_path) -> None:
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--no-input"]
    command += ["--disable-pip-version-check", "--python-version", NEXT, "--only-binary=:all:"]
    found = subprocess.run(
        [*command, "--target", str(tmp_path), *requirements(NEXT)], capture_output=True, text=True
    )
    assert found.returncode == 0, found.stderr
