r"""What a joint motion costs, by name: energies as a controller sees them, torque, smoothness.

Every metric is the time integral of a rate that depends on q̇, q̈, the jerk and the joint torque τ
(armature included). With the gear torque G and motor current i of `dmoc.robot.drive`::

    energy        sum of the axes' electrical power [W -> J], physical: motor work plus losses
    iv_signed     sum of i·V, the UR3 paper's Eq. 6 read as printed [W -> J]
    iv_absolute   sum of |i|·V, the other reading of it
    torque        sum of |τ| [N m s]
    acceleration  sum of q̈² [rad²/s³]
    jerk          sum of jerk² [rad²/s⁵]

i·V multiplies the *motor's* current by the *bus* voltage V, which is not a power: the drive is a
chopper that takes i times its duty cycle from the bus. Both agree only at full duty, so figures in
this metric are not those of a wattmeter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import ProblemError
from dmoc.robot.drive import DriveParams, drive_from_mapping, electrical_power_w
from dmoc.robot.robot import Robot

BUS_VOLTAGE_V = 48.0


class MotionState(NamedTuple):
    """q̇, q̈, jerk and τ, each (..., n)."""

    velocity: Array
    acceleration: Array
    jerk: Array
    torque: Array


def settled(velocity: Array) -> Array:
    """`velocity` with rounding noise (below 1e-12 rad/s) set to 0, in place.

    A curve of equal control points stands still, but its sums leave 1e-16 rad/s, and the sign of
    that would be charged with friction.
    """
    velocity[np.abs(velocity) < 1e-12] = 0.0
    return velocity


class Pull(NamedTuple):
    """A rate (...) and its gradients (..., n) by the fields of `MotionState`; None is zero."""

    rate: Array
    velocity: Array | None = None
    acceleration: Array | None = None
    jerk: Array | None = None
    torque: Array | None = None


@dataclass(frozen=True)
class Metric:
    """`rate(state, smoothing)` → (...) and `pull(state, smoothing)` → `Pull`.

    `smoothing` [rad/s] rounds the kinks of |.| and sgn as in `dmoc.robot.drive`; 0 is exact.
    `needs_torque` is False where inverse dynamics can be left out.
    """

    name: str
    unit: str
    rate: Callable[[MotionState, float], Array]
    pull: Callable[[MotionState, float], Pull]
    needs_torque: bool = True


def metric_of(name: str, robot: Robot) -> Metric:
    """The metric `name` (one of `METRICS`) with the drive parameters of `robot`."""
    if name not in METRICS:
        raise ProblemError.of(
            "metric",
            field="metric",
            value=name,
            legal=" | ".join(METRICS),
            fix="check the spelling",
        )
    return _MAKERS[name](robot)


def _drive(robot: Robot) -> DriveParams:
    return drive_from_mapping(robot.drive, robot.num_joints, robot.provenance)


def _sign(v: Array, s: float) -> tuple[Array, Array]:
    """sgn(v), smoothed by s, and its derivative."""
    if s <= 0:
        return np.sign(v), np.zeros_like(v)
    sign = np.tanh(v / s)
    return sign, (1.0 - sign * sign) / s


def _gear_torque(p: DriveParams, state: MotionState, s: float) -> tuple[Array, Array]:
    """G (..., n) and ∂G/∂q̇."""
    v = state.velocity
    sign, slope = _sign(v, s)
    square = v * v + s * s
    root = square**0.25
    # Where v = 0 and nothing is smoothed, the root's slope is infinite: there sgn is 0, too.
    steep = np.divide(0.5 * v * root, square, out=np.zeros_like(v), where=square > 0)
    level = p.coulomb_nm + p.root_friction_nm_s * root
    torque = (
        state.torque
        + p.extra_inertia_kg_m2 * state.acceleration
        + level * sign
        + p.viscous_nm_s * v
    )
    return torque, p.viscous_nm_s + level * slope + p.root_friction_nm_s * steep * sign


def motor_current_a(params: DriveParams, state: MotionState) -> Array:
    """Motor currents i = G/(n k_t) (..., n) [A], friction included, none of it at standstill."""
    torque, _ = _gear_torque(params, state, 0.0)
    return np.asarray(torque / (params.gear_ratio * params.torque_constant_nm_a))


def _energy(robot: Robot) -> Metric:
    p = _drive(robot)

    def rate(state: MotionState, s: float) -> Array:
        power = electrical_power_w(state.velocity, state.acceleration, state.torque, p, s)
        return np.asarray(power.sum(axis=-1))

    def pull(state: MotionState, s: float) -> Pull:
        v = state.velocity
        gear, gear_by_v = _gear_torque(p, state, s)
        constant = p.gear_ratio * p.torque_constant_nm_a
        current = gear / constant
        if s > 0:
            slope = current / np.sqrt(current**2 + (5.0 * s) ** 2)
        else:
            slope = np.sign(current)
        by_gear = v + (2.0 * (p.copper_ohm + p.inverter_ohm) * current + p.inverter_v * slope) / (
            constant
        )
        sign, sign_by_v = _sign(v, s)
        by_v = (
            gear
            + by_gear * gear_by_v
            + 2.0 * p.eddy_w_s2 * p.gear_ratio**2 * v
            + p.hysteresis_w_s * p.gear_ratio * (sign + v * sign_by_v)
        )
        return Pull(rate(state, s), by_v, by_gear * p.extra_inertia_kg_m2, None, by_gear)

    return Metric("energy", "J", rate, pull)


def _current_metric(name: str, robot: Robot, absolute: bool) -> Metric:
    p = _drive(robot)
    factor = BUS_VOLTAGE_V / (p.gear_ratio * p.torque_constant_nm_a)

    def rate(state: MotionState, s: float) -> Array:
        return pull(state, s).rate

    def pull(state: MotionState, s: float) -> Pull:
        gear, gear_by_v = _gear_torque(p, state, s)
        watts = factor * gear
        if absolute:
            width = 5.0 * s * BUS_VOLTAGE_V
            size = np.sqrt(watts**2 + width**2)
            value = size - width
            slope = factor * np.divide(watts, size, out=np.zeros_like(size), where=size > 0)
        else:
            value, slope = watts, np.broadcast_to(factor, watts.shape)
        return Pull(
            value.sum(axis=-1), slope * gear_by_v, slope * p.extra_inertia_kg_m2, None, slope
        )

    return Metric(name, "J", rate, pull)


def _torque(robot: Robot) -> Metric:
    def pull(state: MotionState, s: float) -> Pull:
        width = 5.0 * s
        size = np.sqrt(state.torque**2 + width**2)
        slope = np.divide(state.torque, size, out=np.zeros_like(size), where=size > 0)
        return Pull((size - width).sum(axis=-1), torque=slope)

    return Metric("torque", "N m s", lambda state, s: pull(state, s).rate, pull)


def _acceleration(robot: Robot) -> Metric:
    def pull(state: MotionState, s: float) -> Pull:
        value = state.acceleration
        return Pull(np.sum(value * value, axis=-1), acceleration=2.0 * value)

    return Metric("acceleration", "rad^2/s^3", lambda x, s: pull(x, s).rate, pull, False)


def _jerk(robot: Robot) -> Metric:
    def pull(state: MotionState, s: float) -> Pull:
        return Pull(np.sum(state.jerk**2, axis=-1), jerk=2.0 * state.jerk)

    return Metric("jerk", "rad^2/s^5", lambda state, s: pull(state, s).rate, pull, False)


_MAKERS: dict[str, Callable[[Robot], Metric]] = {
    "energy": _energy,
    "iv_signed": lambda robot: _current_metric("iv_signed", robot, absolute=False),
    "iv_absolute": lambda robot: _current_metric("iv_absolute", robot, absolute=True),
    "torque": _torque,
    "acceleration": _acceleration,
    "jerk": _jerk,
}

METRICS = tuple(_MAKERS)
