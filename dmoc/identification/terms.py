"""What a joint torque consists of, as columns that are linear in the parameters.

    tau = Y_rb(q, qd, qdd) pi + J qdd + f_c sgn(qd) + f_v qd + o + wrist coupling + s h(q)

`pi` has ten numbers a link in pinocchio's order (m, m c, I about the joint's frame: xx xy yy xz
yz zz). A motor whose speed depends on several joints (a row r of `motor_from_joint`, scaled to 1 at
its own joint) adds inertia and friction in r qd, which act on all of these joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import RobotError
from dmoc.identification.samples import DEAD_ZONE_RAD_S, Samples


@dataclass(frozen=True)
class GasSpring:
    """A gas spring that pulls on a joint: torque falls to zero at `zero_rad`.

    Its ends lie `anchors_m` from the axis; `gas_j` is p V of the filling, `volume_m3` that of the
    shortest spring, `area_m2` what the rod's pull takes from it.
    """

    joint: int
    anchors_m: tuple[float, float]
    zero_rad: float
    area_m2: float
    volume_m3: float
    gas_j: float
    scale: float = 1.0

    def torque_nm(self, q_rad: Array) -> Array:
        """What the motor must add at scale 1 (K,), for joint vectors (K, n)."""
        angle = q_rad[:, self.joint] - self.zero_rad
        near, far = self.anchors_m
        length = np.sqrt(near**2 + far**2 - 2 * near * far * np.cos(angle))
        pulled = length - abs(near - far)
        force = self.area_m2 * self.gas_j / (self.volume_m3 - self.area_m2 * pulled)
        return force * near * far * np.sin(angle) / length


def springs_of(entries: Sequence[Mapping[str, Any]], names: Sequence[str]) -> tuple[GasSpring, ...]:
    """The `springs` of a robot.yaml that was loaded, so checked."""
    given = [{key: v for key, v in entry.items() if key != "kind"} for entry in entries]
    return tuple(GasSpring(**{**entry, "joint": names.index(entry["joint"])}) for entry in given)


@dataclass(frozen=True, eq=False)
class TermColumns:
    """Which column means what, for n joints, coupled motors `rows` (c, n) and springs."""

    model: pin.Model
    couplings: Array
    springs: tuple[GasSpring, ...] = ()

    def __post_init__(self) -> None:
        for name, joint in list(zip(self.model.names, self.model.joints))[1:]:
            if not joint.shortname().startswith("JointModelR"):
                legal, fix = "turning joints", "lock the sliding joint and log the arm alone"
                value = "a joint that slides"
                raise RobotError.of("identification-slides", "", name, value, legal, fix)

    @property
    def num_joints(self) -> int:
        """n."""
        return int(self.model.nv)

    @property
    def num_links(self) -> int:
        """How many of the columns belong to links."""
        return 10 * self.num_joints

    def block(self, name: str) -> slice:
        """Columns of links, armature, coulomb, viscous, offset, coupling or springs."""
        n, c = self.num_joints, len(self.couplings)
        sizes = {
            "links": 10 * n,
            "armature": n,
            "coulomb": n,
            "viscous": n,
            "offset": n,
            "coupling": 3 * c,
            "springs": len(self.springs),
        }
        start = 0
        for key, size in sizes.items():
            if key == name:
                return slice(start, start + size)
            start += size
        return slice(0, start)

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.block("all").stop

    def regressor(self, samples: Samples) -> Array:
        """(M, n, size): torque = regressor @ parameters; columns filtered as the torque was."""
        if samples.fine is not None:
            return samples.filtered(self.regressor(samples.fine))
        q, qd, qdd = samples.q_rad, samples.velocity_rad_s, samples.acceleration_rad_s2
        count, n = q.shape
        out = np.zeros((count, n, self.size))
        data = self.model.createData()
        for k in range(count):
            out[k, :, : 10 * n] = pin.computeJointTorqueRegressor(
                self.model, data, q[k], qd[k], qdd[k]
            )
        index = np.arange(n)
        sign = _sign(qd)
        for name, value in (
            ("armature", qdd),
            ("coulomb", sign),
            ("viscous", qd),
            ("offset", np.ones_like(qd)),
        ):
            out[:, index, self.block(name).start + index] = value
        start = self.block("coupling").start
        for k, row in enumerate(self.couplings):
            speed = qd @ row
            for i, value in enumerate((qdd @ row, _sign(speed), speed)):
                out[:, :, start + 3 * k + i] = value[:, None] * row
        for k, spring in enumerate(self.springs):
            out[:, spring.joint, self.block("springs").start + k] = spring.torque_nm(q)
        return out


def _sign(speed: Array) -> Array:
    return np.where(np.abs(speed) >= DEAD_ZONE_RAD_S, np.sign(speed), 0.0)


def couplings_of(motor_from_joint: Array) -> Array:
    """Rows of R with entries beside the diagonal, divided by their own (c, n)."""
    scaled = motor_from_joint / np.diag(motor_from_joint)[:, None]
    return scaled[np.abs(scaled).sum(axis=1) > 1.0 + 1e-9]
