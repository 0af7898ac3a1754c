"""A small random stream for the kernels: SplitMix64, seeded by a numpy Generator.

Steele, Lea, Flood 2014. numba's own streams are global state; this one is an array of one word.
"""

from __future__ import annotations

import numpy as np

from dmoc.jit import njit


def stream(generator: np.random.Generator) -> np.ndarray:
    """A fresh stream (1,) uint64."""
    return generator.integers(0, 2**63, size=1, dtype=np.uint64)


@njit
def uniform(state):  # type: ignore[no-untyped-def]
    """Next number in [0, 1)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return np.float64(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit
def below(state, n):  # type: ignore[no-untyped-def]
    """Next whole number in 0 … n−1."""
    return min(int(uniform(state) * n), n - 1)
