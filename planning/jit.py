"""numba's `njit` with an on-disk cache where a folder for it can be written."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

__all__ = ["kernel"]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile at the first call; without a writable cache folder, in every process anew.

    `error_model="numpy"` drops the check for a zero divisor: the kernels guard theirs.
    """
    options = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no place for a cache (read-only installation, no home)
        return numba.njit(**options)(function)
