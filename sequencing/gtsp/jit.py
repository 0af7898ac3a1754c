"""numba's `njit`, cached on disk where there is a place to write, uncached elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def jit(function: Callable[..., Any]) -> Any:
    """Compile at the first call; keep the machine code on disk if a cache directory is writable.

    numba refuses to decorate a function when neither the package's folder nor the user's cache
    folder can be written (read-only installations, containers without a home): then the function
    is compiled in every process instead. Set NUMBA_CACHE_DIR to give it a place.
    """
    try:
        return numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:  # "no locator available"
        return numba.njit(nogil=True)(function)
