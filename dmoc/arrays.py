"""Read-only arrays for frozen types."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from dmoc.errors import ProblemError

Array = npt.NDArray[np.float64]

# Of an archive, unpacked: far more than any file of ours, far less than would exhaust a machine.
MOST_BYTES = 1 << 28
_DAMAGE = (
    EOFError,
    KeyError,
    MemoryError,
    NotImplementedError,
    OSError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TypeError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)


def readonly(values: Any, name: str, ndim: int) -> Array:
    """A read-only float64 copy of `values` with `ndim` axes and only finite entries."""
    array = np.array(values, dtype=np.float64)
    if array.ndim != ndim or not np.all(np.isfinite(array)):
        bad = f"shape {array.shape}" if array.ndim != ndim else "NaN or infinite entries"
        raise ProblemError.of(
            "array",
            field=name,
            value=bad,
            legal=f"{ndim} axes, finite numbers",
            fix=f"check what was passed as {name}",
        )
    array.setflags(write=False)
    return array


def joint_vector(values: Any, name: str, num_joints: int) -> Array:
    """A read-only joint vector (n,); a scalar is repeated for every joint."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0:
        array = np.full(num_joints, float(array))
    if array.shape != (num_joints,):
        raise ProblemError.of(
            "joint-vector",
            field=name,
            value=f"shape {array.shape}",
            legal=f"({num_joints},)",
            fix="give one number per joint of the robot",
        )
    return readonly(array, name, ndim=1)


def arrays_of(content: bytes) -> dict[str, npt.NDArray[Any]]:
    """The arrays of a numpy archive, never a pickle; `ValueError` for anything else.

    What the archive says it holds is added up before any of it is unpacked: a small file may not
    grow beyond `MOST_BYTES`, and an array not beyond its own member.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            total = sum(member.file_size for member in archive.infolist())
        if total > MOST_BYTES:
            raise ValueError(f"{total} bytes when unpacked, more than {MOST_BYTES}")
        found = {}
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            for member in archive.infolist():
                data = archive.read(member)
                found[member.filename.removesuffix(".npy")] = _array_of(data)
        return found
    except _DAMAGE as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _array_of(data: bytes) -> npt.NDArray[Any]:
    stream, npy = io.BytesIO(data), np.lib.format
    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    shape, _, kind = read[npy.read_magic(stream)](stream)
    count = 1
    for length in shape:
        count *= length
    if kind.hasobject or count * kind.itemsize != len(data) - stream.tell():
        raise ValueError("an array of objects, or one that is longer than its bytes")
    return npy.read_array(io.BytesIO(data), allow_pickle=False)


class StaysReadonly:
    """A frozen type whose arrays come back read-only from a pickle."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)
