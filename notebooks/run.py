"""Execute the notebooks: every percent script in this folder, results into `_built/`.

    python notebooks/run.py [--reduced] [NAME …]

The sources hold no outputs. `--reduced` sets DMOC_REDUCED=1, with which every notebook does a
smaller version of its work. Exits 1 when a notebook fails and prints the cell's traceback.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError
from nbconvert import HTMLExporter

FOLDER = Path(__file__).resolve().parent
BUILT = FOLDER / "_built"


def names() -> list[str]:
    """Notebooks of this folder: scripts with a jupytext header."""
    return sorted(
        path.stem
        for path in FOLDER.glob("*.py")
        if path.name != "run.py" and "jupytext:" in path.read_text(encoding="utf-8")[:400]
    )


def execute(name: str, cell_timeout_s: int) -> str:
    """Execute a notebook in `_built/`, write .ipynb and .html; the error, or an empty text."""
    notebook = jupytext.read(FOLDER / f"{name}.py")
    client = NotebookClient(
        notebook,
        timeout=cell_timeout_s,
        kernel_name="python3",
        resources={"metadata": {"path": str(BUILT)}},
    )
    error = ""
    try:
        client.execute()
    except (CellExecutionError, CellTimeoutError, DeadKernelError) as failure:
        error = str(failure)
    nbformat.write(notebook, BUILT / f"{name}.ipynb")
    page, _ = HTMLExporter().from_notebook_node(notebook)
    (BUILT / f"{name}.html").write_text(page, encoding="utf-8")
    return error


def main() -> int:
    """Run what the command line names (all by default); the number of failures as exit code 0/1."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(names()))
    parser.add_argument("--reduced", action="store_true", help="the smaller version of each")
    parser.add_argument("--timeout", type=int, default=1800, help="seconds a cell may take")
    arguments = parser.parse_args()
    chosen = arguments.names or names()
    unknown = sorted(set(chosen) - set(names()))
    if unknown:
        parser.error(f"no notebook named {', '.join(unknown)}; there are {', '.join(names())}")
    if arguments.reduced:
        os.environ["DMOC_REDUCED"] = "1"
    else:
        os.environ.pop("DMOC_REDUCED", None)
    # The kernel must import the packages of this folder's project, installed or not.
    os.environ["PYTHONPATH"] = os.pathsep.join(
        filter(None, [str(FOLDER.parent), os.environ.get("PYTHONPATH")])
    )
    BUILT.mkdir(exist_ok=True)
    failed = 0
    for name in chosen:
        began = time.monotonic()
        error = execute(name, arguments.timeout)
        print(f"{name}: {'FAILED' if error else 'ok'} ({time.monotonic() - began:.0f} s)")
        if error:
            failed += 1
            print(error, file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
