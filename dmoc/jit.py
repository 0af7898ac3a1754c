"""The one place where kernels are compiled: numba's `njit` with the flags of this house."""

from __future__ import annotations

import os
import pickle
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core.options import DefaultOptions

# numba's own switch for code without reference counts; a version that has none counts them.
_PLAIN = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def njit(
    function: Callable[..., Any] | None = None,
    *,
    inner: bool = False,
    plain: bool = False,
    fastmath: bool = False,
) -> Any:
    """Compile at the first call and keep the code on disk, wherever a folder can be written.

    `inner` is for kernels that only other kernels call: without the entry from Python, which costs
    a third of the time to compile it. `plain` is for kernels that make no arrays at all and so need
    no reference counts: counting costs a small function that is handed arrays more than its work
    (the distance of two pieces is four times as fast without). `fastmath` lets sums be reordered.

    `error_model="numpy"` drops the check for a zero divisor: the kernels guard theirs. Compiling
    takes seconds on a fresh machine, so large kernels avoid what makes numba compile more than they
    say: no arrays made inside (workspace comes from the caller), no `min` and `max`, no whole rows
    assigned, and no literal whole numbers as arguments (each value is a type of its own).
    """
    if function is None:
        return lambda given: njit(given, inner=inner, plain=plain, fastmath=fastmath)
    options: dict[str, Any] = {
        "nogil": True,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": inner,
        "fastmath": fastmath,
        **(_PLAIN if plain else {}),
    }
    try:
        return _forgiving(numba.njit(cache=True, **options)(function))
    except RuntimeError:  # neither the installation nor a home can be written
        return _kept_elsewhere(function, options)


def _forgiving(kernel: Any) -> Any:
    """The kernel, compiled anew where its kept code names types that are no longer there.

    numba reads the whole list of what was kept before it looks whether the source changed: after
    an update that renamed a type it would end in an AttributeError.
    """
    file = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    read = getattr(file, "_load_index", None)
    if file is not None and read is not None:

        def load_index() -> Any:
            try:
                return read()
            except (
                AttributeError,
                ImportError,
                EOFError,
                TypeError,
                ValueError,
                pickle.PickleError,
            ):
                return {}

        file._load_index = load_index
    return kernel


def _kept_elsewhere(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Compiled code in the user's own folder for temporary files, else in every process anew."""
    asked, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _own_folder() or ""
    try:
        return _forgiving(numba.njit(cache=True, **options)(function))
    except RuntimeError:
        return numba.njit(**options)(function)
    finally:
        numba.config.CACHE_DIR = asked


def _own_folder() -> str | None:
    """A folder that nobody else can write: numba runs what it finds in there."""
    try:
        folder = Path(tempfile.gettempdir()) / f"dmoc-kernels-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    mine = found.st_uid == os.getuid() and not found.st_mode & 0o077 and folder.is_dir()
    return str(folder) if mine and not folder.is_symlink() else None
