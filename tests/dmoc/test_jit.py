"""Kernels are compiled in one place, and run where neither the installation nor a home is ours."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = [ROOT / name for name in ("dmoc", "planning", "sequencing", "studies")]
SOURCES = [path for folder in PACKAGES if folder.is_dir() for path in folder.rglob("*.py")]

RUN_KERNELS = """
import importlib, pkgutil, numpy as np, sequencing
kernels = {}
for found in pkgutil.walk_packages(sequencing.__path__, "sequencing."):
    module = importlib.import_module(found.name)
    kernels |= {n: k for n, k in vars(module).items() if hasattr(k, "py_func")}
assert len(kernels) > 20, kernels
across, along = np.eye(3)[:2] + 1.0, np.array([[0.0, 0, 0], [0, 0, 5.0]])
assert abs(kernels["segment_distance"](across, along) - 1.5 * 2**0.5) < 1e-12
print(kernels["segment_distance"]._cache.cache_path)
"""


def _imports_numba(source: str) -> bool:
    names = [
        name
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in (
            [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else [alias.name for alias in node.names]
        )
    ]
    return any(name.split(".")[0] == "numba" for name in names)


def test_only_one_file_knows_numba():
    assert [p.name for p in SOURCES if _imports_numba(p.read_text())] == ["jit.py"]


@pytest.mark.parametrize("has_temporary_folder", [True, False])
def test_kernels_run_from_a_read_only_installation_without_a_home(tmp_path, has_temporary_folder):
    installed, scratch = tmp_path / "installed", tmp_path / "scratch"
    scratch.mkdir()
    for package in PACKAGES:
        if package.is_dir():
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(package, installed / package.name, ignore=ignored)
    # A file in the place of the cache folder stops the superuser too.
    for folder in [installed, *installed.rglob("*")]:
        if folder.is_dir():
            (folder / "__pycache__").touch()
    own = scratch / f"dmoc-kernels-{os.getuid()}"
    if not has_temporary_folder:
        own.touch()
    keep = {k: v for k, v in os.environ.items() if not k.startswith(("HOME", "NUMBA", "XDG"))}
    done = subprocess.run(
        [sys.executable, "-B", "-c", RUN_KERNELS],
        capture_output=True,
        text=True,
        check=False,
        cwd=scratch,
        env=keep
        | {
            "HOME": "/dev/null",
            "PYTHONPATH": str(installed),
            "TMPDIR": str(scratch),
        },
    )
    assert done.returncode == 0, done.stderr[-2000:]
    if has_temporary_folder:
        assert done.stdout.strip().startswith(str(own))
        assert list(own.rglob("*.nbc"))
    else:
        assert done.stdout.strip() == "None"


MODULE = """
from typing import NamedTuple
from dmoc.jit import njit

class {name}(NamedTuple):
    value: float

@njit
def twice(item):
    return 2.0 * item.value

print(twice({name}(1.5)))
"""


def test_kept_code_of_a_type_that_is_gone_is_compiled_anew(tmp_path):
    """An update in place that renamed a type ended in an AttributeError of numba's cache."""
    for name in ("Old", "New"):
        (tmp_path / "kernel_of_test.py").write_text(MODULE.format(name=name))
        done = subprocess.run(
            [sys.executable, "-c", "import kernel_of_test"],
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"},
        )
        assert done.stdout.strip() == "3.0", done.stderr
    assert list((tmp_path / "__pycache__").glob("*.nbi"))
