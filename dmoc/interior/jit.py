"""numba's `njit` for the kernels of this package, cached on disk where a folder can be written."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

__all__ = ["kernel"]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile at the first call; `error_model="numpy"` drops the checks for zero divisors."""
    try:
        return numba.njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)(function)
    except RuntimeError:  # no place for a cache (read-only installation, no home)
        return numba.njit(error_model="numpy")(function)
