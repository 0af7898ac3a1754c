"""numba's `njit` with an on-disk cache where a folder for it can be written."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core.options import DefaultOptions

__all__ = ["inner", "kernel", "plain_inner", "plain_kernel"]


# numba's own switch for code without reference counts; a version that has none counts them.
_PLAIN = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile at the first call; without a writable cache folder, in every process anew.

    `error_model="numpy"` drops the check for a zero divisor: the kernels guard theirs. Compiling
    them takes seconds on a fresh machine, so the kernels avoid what makes numba compile more than
    they say: no arrays made inside (workspace comes from the caller), no `min` and `max`, no whole
    rows assigned, and no literal whole numbers as arguments (each value is a type of its own).
    """
    return _compiled(function)


def inner(function: Callable[..., Any]) -> Any:
    """A `kernel` that only other kernels call: without the entry from Python, which costs a third
    of the time to compile it.
    """
    return _compiled(function, no_cpython_wrapper=True)


def plain_kernel(function: Callable[..., Any]) -> Any:
    """A `kernel` that makes no arrays at all, and so needs no reference counts.

    Counting costs a small function that is handed arrays more than its work: the distance of two
    pieces is four times as fast without.
    """
    return _compiled(function, **_PLAIN)


def plain_inner(function: Callable[..., Any]) -> Any:
    """A `plain_kernel` that only other kernels call."""
    return _compiled(function, no_cpython_wrapper=True, **_PLAIN)


def _compiled(function: Callable[..., Any], **more: bool) -> Any:
    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, **more}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no place for a cache (read-only installation, no home)
        return numba.njit(**options)(function)
