"""Read-only arrays for frozen types."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from dmoc.errors import Fault, ProblemError

Array = npt.NDArray[np.float64]


def readonly(values: Any, name: str, ndim: int) -> Array:
    """A read-only float64 copy of `values` with `ndim` axes and only finite entries."""
    array = np.array(values, dtype=np.float64)
    if array.ndim != ndim or not np.all(np.isfinite(array)):
        bad = f"shape {array.shape}" if array.ndim != ndim else "NaN or infinite entries"
        raise ProblemError(
            Fault(
                "array",
                field=name,
                value=bad,
                legal=f"{ndim} axes, finite numbers",
                fix=f"check what was passed as {name}",
            )
        )
    array.setflags(write=False)
    return array


def joint_vector(values: Any, name: str, num_joints: int) -> Array:
    """A read-only joint vector (n,); a scalar is repeated for every joint."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0:
        array = np.full(num_joints, float(array))
    if array.shape != (num_joints,):
        raise ProblemError(
            Fault(
                "joint-vector",
                field=name,
                value=f"shape {array.shape}",
                legal=f"({num_joints},)",
                fix="give one number per joint of the robot",
            )
        )
    return readonly(array, name, ndim=1)


class StaysReadonly:
    """A frozen type whose arrays come back read-only from a pickle."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)
