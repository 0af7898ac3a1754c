"""What is wrong with a log: signs that something is, and mistakes that would explain it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import Fault
from dmoc.identification.samples import Samples
from dmoc.identification.terms import TermColumns
from dmoc.robot.robot import Robot

#: Misfit over that of plain least squares, in sums of squares.
MOST_MISFIT = 1.4**2
_MOST_MASS, _MOST_ROTOR, _SPRING = 3.0, 2.0, (0.5, 1.5)


@dataclass(frozen=True)
class Hypothesis:
    """One mistake: joints whose torque or axis is reversed, zeros that are off, gravity."""

    code: str
    field: str
    legal: str
    fix: str
    torque: tuple[int, ...] = ()
    axis: tuple[int, ...] = ()
    zeros_rad: tuple[tuple[int, float], ...] = ()
    gravity: bool = False

    def samples(self, run: Samples) -> Samples:
        """The run with the mistake put right."""
        sign, turn, zero = (np.ones(run.q_rad.shape[1]) for _ in range(3))
        sign[list(self.torque + self.axis)] = -1.0
        turn[list(self.axis)] = -1.0
        zero[:] = 0.0
        for joint, angle in self.zeros_rad:
            zero[joint] = angle
        return replace(
            run,
            q_rad=run.q_rad * turn + zero,
            velocity_rad_s=run.velocity_rad_s * turn,
            acceleration_rad_s2=run.acceleration_rad_s2 * turn,
            torque_nm=run.torque_nm * sign,
            fine=None if run.fine is None else self.samples(run.fine),
        )

    def model(self, model: pin.Model) -> pin.Model:
        """The model with gravity as it would be."""
        out = pin.Model(model)
        if self.gravity:
            out.gravity.linear = -out.gravity.linear
        return out


def hypotheses(names: Sequence[str]) -> tuple[Hypothesis, ...]:
    """Every mistake that is tried, for joints of these names."""
    joints = range(len(names))
    right = np.pi / 2
    out = [
        Hypothesis(
            "identify-sign",
            names[j],
            "torque positive along the joint",
            "reverse the torque of this joint",
            torque=(j,),
        )
        for j in joints
    ]
    out += [
        Hypothesis(
            "identify-axis",
            names[j],
            "the joint's positive direction as in the URDF",
            "reverse position and torque of this joint",
            axis=(j,),
        )
        for j in joints
    ]
    out.append(
        Hypothesis(
            "identify-gravity",
            "gravity",
            "gravity along -z of the base",
            "give the base's mounting (floor, wall, ceiling)",
            gravity=True,
        )
    )
    shifts: list[tuple[tuple[int, float], ...]] = [
        ((j, s * right),) for j in joints for s in (1, -1)
    ]
    shifts += [((1, s * right), (2, t * right)) for s in (1, -1) for t in (1, -1)]
    out += [
        Hypothesis(
            "identify-home",
            ", ".join(names[j] for j, _ in shift),
            "the URDF's zero",
            "add " + ", ".join(f"{np.degrees(a):+.0f}° to {names[j]}" for j, a in shift),
            zeros_rad=shift,
        )
        for shift in shifts
        if all(j < len(names) for j, _ in shift)
    ]
    return tuple(out)


def suspicions(
    robot: Robot,
    layout: TermColumns,
    values: Array,
    prior: Array,
    ratio: float,
    still: Sequence[Fault],
) -> tuple[Fault, ...]:
    """Signs of a mistake in the fitted numbers, as doubts."""
    out = []
    names = list(robot.model.names)[1:]
    skip = {fault.field for fault in still}
    fix = "see the cause named, or judge the prior of the robot file"
    rotor = prior[layout.block("armature")]

    def doubt(code: str, where: str, value: str, legal: str) -> None:
        out.append(Fault(code, "", where, value, legal, fix))

    for block in ("coulomb", "viscous"):
        found = values[layout.block(block)]
        for j in map(int, np.flatnonzero(found < 1e-3 * max(1.0, float(found.max())))):
            if names[j] not in skip:
                doubt("identify-bound", names[j], f"{block} friction {found[j]:.3g}", "> 0")
    if ratio > MOST_MISFIT:
        value = f"{ratio:.2f} x the squares of plain least squares"
        doubt("identify-misfit", "all joints", value, f"<= {MOST_MISFIT:.2f}")
    for j, name in enumerate(names):
        mass = values[10 * j] / prior[10 * j]
        if not 1 / _MOST_MASS <= mass <= _MOST_MASS:
            value = f"{values[10 * j]:.4g} kg, {mass:.2g} x the robot file"
            doubt("identify-mass", name, value, f"within a factor {_MOST_MASS:g}")
        found = values[layout.block("armature")][j]
        if name not in skip and rotor[j] > 0 and not 0.5 <= found / rotor[j] <= _MOST_ROTOR:
            value = f"{found:.4g} kg m², {found / rotor[j]:.2g} x the robot file"
            doubt("identify-armature", name, value, f"within a factor {_MOST_ROTOR:g}")
    for spring, scale in zip(layout.springs, values[layout.block("springs")]):
        if not _SPRING[0] <= scale <= _SPRING[1]:
            doubt("identify-spring", names[spring.joint], f"scale {scale:.2g}", "0.5–1.5")
    return tuple(out)
