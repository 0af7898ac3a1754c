"""Compiled inverse dynamics of a serial arm, forward and adjoint, over many samples at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.robot.robot import Robot
from studies.ur3.adjoint_kernels import adjoint_kernel, torque_kernel


@dataclass(frozen=True, eq=False)
class LinkChain:
    """The constants of n revolute joints in a row; link frames as in `robot.model`.

    `rotation` (n, 3, 3) and `offset_m` (n, 3) place joint i in its parent's frame at q = 0, `axis`
    (n, 3) is its axis, `mass_kg` (n,), `com_m` (n, 3) and `inertia_kg_m2` (n, 3, 3) (about the
    centre of mass) are those of the link it moves, tool and payload included; `armature_kg_m2`
    (n,); `gravity_m_s2` (3,).
    """

    rotation: Array
    offset_m: Array
    axis: Array
    mass_kg: Array
    com_m: Array
    inertia_kg_m2: Array
    armature_kg_m2: Array
    gravity_m_s2: Array

    @property
    def parts(self) -> tuple[Array, ...]:
        """The arguments of the kernels."""
        return (
            self.rotation,
            self.offset_m,
            self.axis,
            self.mass_kg,
            self.com_m,
            self.inertia_kg_m2,
            self.armature_kg_m2,
            self.gravity_m_s2,
        )

    def torque_nm(self, q: Array, v: Array, a: Array) -> Array:
        r"""τ = M(q) a + c(q, v) + g(q) [N·m], armature included; all arrays (..., n).

        Equals `pin.rnea`, with which the tests compare it.
        """
        shape = q.shape
        flat = (np.ascontiguousarray(x).reshape(-1, shape[-1]) for x in (q, v, a))
        return np.asarray(torque_kernel(*flat, *self.parts)).reshape(shape)

    def pull_back(self, q: Array, v: Array, a: Array, weight: Array) -> tuple[Array, Array, Array]:
        """Gradients (..., n) of Σ weight·τ(q, v, a) with respect to q, v and a.

        Reverse mode through the recursion: about three times the work of `torque_nm`.
        """
        shape = q.shape
        flat = (np.ascontiguousarray(x).reshape(-1, shape[-1]) for x in (q, v, a, weight))
        gradients = adjoint_kernel(*flat, *self.parts)
        return (
            gradients[0].reshape(shape),
            gradients[1].reshape(shape),
            gradients[2].reshape(shape),
        )


def chain_of(robot: Robot) -> LinkChain:
    """The `LinkChain` of a robot, its tool, payload and base placement."""
    model, n = robot.model, robot.num_joints
    data, neutral = model.createData(), np.zeros(n)
    axes = [pin.computeJointJacobian(model, data, neutral, i + 1)[3:, i].copy() for i in range(n)]
    # At q = 0 a joint's own transform is the identity, so its frame is its placement.
    values = {
        "rotation": [model.jointPlacements[i + 1].rotation for i in range(n)],
        "offset_m": [model.jointPlacements[i + 1].translation for i in range(n)],
        "axis": axes,
        "mass_kg": [model.inertias[i + 1].mass for i in range(n)],
        "com_m": [model.inertias[i + 1].lever for i in range(n)],
        "inertia_kg_m2": [model.inertias[i + 1].inertia for i in range(n)],
        "armature_kg_m2": model.armature,
        "gravity_m_s2": model.gravity.linear,
    }
    return LinkChain(**{name: np.array(value, dtype=float) for name, value in values.items()})
