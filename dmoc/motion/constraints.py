"""What a motion must respect beyond the robot's own limits."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from dmoc.arrays import Array
from dmoc.errors import Fault, ProblemError


def _require_inputs(function: ca.Function, kind: str, shapes: str, count: int) -> None:
    if function.n_in() != count or function.n_out() != 1 or function.size2_out(0) != 1:
        raise ProblemError.of(
            "constraint-function",
            field=kind,
            value=str(function),
            legal=f"a CasADi function {shapes} -> (m)",
            fix="take exactly these columns and return one column",
        )


def _range(owner: Any, rows: int) -> None:
    """Lower and upper as read-only (rows,) arrays; infinity means one-sided."""
    for name in ("lower", "upper"):
        value = np.array(np.broadcast_to(np.asarray(getattr(owner, name), dtype=float), (rows,)))
        value.setflags(write=False)
        object.__setattr__(owner, name, value)
    if (
        np.any(np.isnan(owner.lower))
        or np.any(np.isnan(owner.upper))
        or np.any(owner.lower > owner.upper)
    ):
        raise ProblemError.of(
            "constraint-range",
            field=type(owner).__name__,
            value=f"[{owner.lower}, {owner.upper}]",
            legal="lower <= upper, no NaN",
            fix="swap or correct the bounds",
        )


@dataclass(frozen=True)
class PathConstraint:
    """lower ≤ c(q, q̇, u) ≤ upper at the midpoint of every interval (equation 1c of the paper).

    `function` is a CasADi function (q (n), v (n), u (n)) -> (m) in rad, rad/s, N·m.
    """

    function: ca.Function
    lower: Array | float
    upper: Array | float

    def __post_init__(self) -> None:
        _require_inputs(self.function, "PathConstraint.function", "(q, v, u)", 3)
        _range(self, self.function.size1_out(0))


@dataclass(frozen=True)
class EndCondition:
    """lower ≤ H(q_N, q̇_N, T) ≤ upper (equation 1d); `function` is (q (n), v (n), T) -> (m)."""

    function: ca.Function
    lower: Array | float = 0.0
    upper: Array | float = 0.0

    def __post_init__(self) -> None:
        _require_inputs(self.function, "EndCondition.function", "(q, v, T)", 3)
        _range(self, self.function.size1_out(0))


@dataclass(frozen=True)
class EndCost:
    """Φ(q_N, q̇_N, T), added to the cost (equation 1a); `function` is (q (n), v (n), T) -> (1)."""

    function: ca.Function

    def __post_init__(self) -> None:
        _require_inputs(self.function, "EndCost.function", "(q, v, T)", 3)


@dataclass(frozen=True)
class TorqueSpeed:
    """The line of a DC motor: |u/stall + q̇/no-load| ≤ 1, each (n,) or one number.

    Driving at speed leaves less torque; braking is not weakened.
    """

    stall_torque_nm: Array | float
    no_load_speed_rad_s: Array | float


@dataclass(frozen=True)
class MotionLimits:
    """Limits of one motion on top of the robot's own; None and () leave them out.

    `jerk_limit_rad_s3` (n,) bounds how the acceleration of the executed curve changes from interval
    to interval, per second, the standstill (or steady speed) before and after the motion included;
    `rms_torque_nm` (n,) the root mean square of each torque; `torque_speed` the motor line; `path`
    are constraints at all midpoints. `end_cost` and `end` act on the last state, of which
    `free_goal_joints` are free within their limits and, with `free_goal_velocity`, the velocity
    within its limits.
    """

    jerk_limit_rad_s3: Array | float | None = None
    rms_torque_nm: Array | float | None = None
    torque_speed: TorqueSpeed | None = None
    path: tuple[PathConstraint, ...] = ()
    end: tuple[EndCondition, ...] = ()
    end_cost: EndCost | None = None
    free_goal_joints: tuple[int, ...] = ()
    free_goal_velocity: bool = False

    def __post_init__(self) -> None:
        faults = []
        values: dict[str, Any] = {
            "jerk_limit_rad_s3": self.jerk_limit_rad_s3,
            "rms_torque_nm": self.rms_torque_nm,
        }
        if self.torque_speed is not None:
            values["torque_speed.stall_torque_nm"] = self.torque_speed.stall_torque_nm
            values["torque_speed.no_load_speed_rad_s"] = self.torque_speed.no_load_speed_rad_s
        for name, value in values.items():
            if value is not None and not np.all(np.asarray(value, dtype=float) > 0):
                faults.append(
                    Fault(
                        "limit",
                        field=f"limits.{name}",
                        value=str(value),
                        legal="> 0",
                        fix="leave it out for no limit",
                    )
                )
        if faults:
            raise ProblemError(faults)

    @property
    def needs_end_state(self) -> bool:
        """Whether the last velocity has to be a variable."""
        return self.free_goal_velocity or self.end_cost is not None or bool(self.end)

    @property
    def shape(self) -> tuple[Any, ...]:
        """What of these limits changes the programme and not just its parameters."""
        functions = [item.function for item in self.path]
        functions += [item.function for item in self.end]
        functions += [self.end_cost.function] if self.end_cost else []
        return (
            self.rms_torque_nm is not None,
            self.torque_speed is not None,
            self.needs_end_state,
            len(self.path),
            len(self.end),
            *(_fingerprint(function) for function in functions),
        )


def _fingerprint(function: ca.Function) -> str:
    return hashlib.sha256(function.serialize().encode()).hexdigest()
