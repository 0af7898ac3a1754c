"""Values, Jacobians and Hessians of a programme's blocks, copy by copy, in flat arrays.

The stage functions write straight into memory that the kernels read: no sparse matrix is built.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from dmoc.arrays import Array
from dmoc.interior.frames import Frames


class Oracle:
    """The blocks of `frames` with their memory.

    `values` holds the rows of all copies of all blocks, `slopes` the nonzeros of their Jacobians,
    `curves` those of their Hessians' upper triangles (blocks without curvature left out).
    """

    def __init__(self, frames: Frames) -> None:
        self.frames = frames
        blocks = frames.blocks
        self._z = np.zeros(len(frames.variables))
        self._lam = np.zeros(len(frames.multipliers))
        self._lam_of_rows = np.ones(1 + max(int(frames.rows.max()) + 1, frames.num_momentum))
        self.values = np.zeros(len(frames.rows))
        self.slopes = np.zeros(sum(b.copies * b.stage.jac_sparsity.nnz() for b in blocks))
        self.curves = np.zeros(sum(b.copies * b.stage.hess_sparsity.nnz() for b in blocks))
        self._theta = [np.zeros((block.copies, block.stage.num_params)) for block in blocks]
        self._kept: list[Any] = []
        self._rows_calls: list[Callable[[], Any]] = []
        self._jac_calls: list[Callable[[], Any]] = []
        self._hess_calls: list[Callable[[], Any]] = []
        at = np.zeros(4, dtype=np.int64)
        for block, theta in zip(blocks, self._theta):
            stage, copies = block.stage, block.copies
            local, rows = copies * stage.num_local, copies * stage.num_rows
            sizes = [
                local,
                rows,
                copies * stage.jac_sparsity.nnz(),
                copies * stage.hess_sparsity.nnz(),
            ]
            z, lam, values, slopes, curves = (
                memory[at[i] : at[i] + sizes[i]]
                for memory, i in (
                    (self._z, 0),
                    (self._lam, 1),
                    (self.values, 1),
                    (self.slopes, 2),
                    (self.curves, 3),
                )
            )
            at += sizes
            values_of, slopes_of, curves_of = (part.map(copies) for part in stage.parts)
            self._rows_calls.append(self._call(values_of, (z, theta), (values,)))
            self._jac_calls.append(self._call(slopes_of, (z, theta), (values, slopes)))
            if sizes[3]:
                self._hess_calls.append(self._call(curves_of, (z, theta, lam), (curves,)))

    def _call(
        self, function: ca.Function, inputs: tuple[Array, ...], outputs: tuple[Array, ...]
    ) -> Callable[[], Any]:
        made: Any = function.buffer()
        buffer, run = made
        for arrays, place in ((inputs, buffer.set_arg), (outputs, buffer.set_res)):
            for i, array in enumerate(arrays):
                memory: Any = array
                if array.size:
                    place(i, memoryview(memory))
        self._kept.append((function, buffer))
        return run

    def set_params(self, p: Array) -> None:
        """The parameter vector of the programme for what follows."""
        for block, theta in zip(self.frames.blocks, self._theta):
            theta[:] = p[block.params] if block.params.ndim == 1 else p[block.params].T

    def rows(self, x: Array) -> None:
        """`values` at x."""
        np.take(x, self.frames.variables, out=self._z)
        for call in self._rows_calls:
            call()

    def jacobian(self, x: Array) -> None:
        """`values` and `slopes` at x."""
        np.take(x, self.frames.variables, out=self._z)
        for call in self._jac_calls:
            call()

    def hessian(self, x: Array, multipliers: Array) -> None:
        """`curves` at x of objective plus rows times `multipliers`."""
        np.take(x, self.frames.variables, out=self._z)
        self._lam_of_rows[1 : 1 + len(multipliers)] = multipliers
        np.take(self._lam_of_rows, self.frames.multipliers, out=self._lam)
        for call in self._hess_calls:
            call()
