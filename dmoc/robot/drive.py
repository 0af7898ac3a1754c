"""Motor, gear, friction and inverter losses: from joint motion to electrical power.

Energy flow of one axis (DTO paper, Fig. 2, inverter to motor to gear to joint), in joint
coordinates with gear ratio n, motor constant k_t and motor speed omega = n qd::

    tau_gear = tau + f_c sgn(qd) + f_v qd + f_s sgn(qd) sqrt|qd| + J_x qdd     [Nm, joint side]
    i        = tau_gear / (n k_t)                                            [A]
    P_axis   = tau_gear qd + R i^2 + k_e omega^2 + k_h |omega| + v_0 |i| + r_0 i^2 + P_0   [W]

`tau` is the rigid-body joint torque **including the rotor's armature** n^2 J_m qdd, as
`pin.rnea` returns it when `model.armature` is set, which `dmoc.load_robot` does. J_x is inertia
that the model does *not* hold (zero for our robots), so nothing is counted twice. Negative power
flows back into the DC link; what happens to it there is `sequencing.timing.power.dc_link`'s affair.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from dmoc.errors import Fault, RobotError

REST_RAD_S = 1e-12
"""Slower joints stand still: they have neither friction nor iron losses."""

_REQUIRED = ("gear_ratio", "torque_constant_nm_a", "copper_ohm")


@dataclass(frozen=True, eq=False)
class DriveParams:
    """Loss parameters of n axes; every array has shape (n,) and is read-only.

    `copper_ohm` multiplies i^2: 3 R_phase when i is a phase rms current, 1.5 R_phase when it is a
    q-axis amplitude (as Universal Robots report it). `base_power_w` is the robot's constant
    consumption on the grid side (controller, fans) with motors on; it is not part of
    `electrical_power_w`. `provenance` maps each field to `measured`, `published: source` or
    `assumed`.
    """

    gear_ratio: np.ndarray
    torque_constant_nm_a: np.ndarray
    copper_ohm: np.ndarray
    coulomb_nm: np.ndarray
    viscous_nm_s: np.ndarray
    root_friction_nm_s: np.ndarray  # f_s of the sqrt|qd| term, Nm/(rad/s)^0.5
    eddy_w_s2: np.ndarray  # k_e, W/(rad/s)^2 at the motor
    hysteresis_w_s: np.ndarray  # k_h, W/(rad/s) at the motor
    inverter_v: np.ndarray
    inverter_ohm: np.ndarray
    idle_w: np.ndarray  # P_0 of each axis, on the link
    extra_inertia_kg_m2: np.ndarray  # J_x at the joint, absent from the rigid-body model
    base_power_w: float = 0.0
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        faults: list[Fault] = []
        size = np.atleast_1d(np.asarray(self.gear_ratio, dtype=float)).size
        for name in array_fields():
            value = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            if value.size == 1:
                value = np.full(size, float(value[0]))
            positive = name in _REQUIRED[:2]
            bad = ~np.isfinite(value) | ((value <= 0) if positive else (value < 0))
            if value.shape != (size,) or bad.any():
                legal = f"{size} finite numbers, {'> 0' if positive else '>= 0'}"
                faults.append(Fault("drive-value", "", f"drive.{name}", str(value), legal))
                continue
            value = value.copy()
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if not (np.isfinite(self.base_power_w) and self.base_power_w >= 0):
            faults.append(
                Fault("drive-value", "", "drive.base_power_w", str(self.base_power_w), ">= 0")
            )
        for name, tag in self.provenance.items():
            if tag not in ("measured", "assumed") and not tag.startswith("published"):
                legal = "measured | published: SOURCE | assumed"
                faults.append(Fault("provenance-tag", "", f"provenance.{name}", tag, legal))
        if faults:
            raise RobotError(faults)
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))

    def __reduce__(self) -> tuple[Any, ...]:
        values = [getattr(self, f.name) for f in fields(self) if f.name != "provenance"]
        return (DriveParams, (*values, dict(self.provenance)))

    @property
    def num_joints(self) -> int:
        """Number of axes n."""
        return int(self.gear_ratio.size)

    def tag(self, name: str) -> str:
        """Provenance of one parameter; what nobody vouched for is `assumed`."""
        return self.provenance.get(name, "assumed")

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, for reports and fingerprints."""
        data: dict[str, Any] = {name: getattr(self, name).tolist() for name in array_fields()}
        data["base_power_w"] = float(self.base_power_w)
        return data


def array_fields() -> tuple[str, ...]:
    """Names of the per-joint fields of `DriveParams`."""
    return tuple(
        f.name for f in fields(DriveParams) if f.name not in ("base_power_w", "provenance")
    )


def electrical_power_w(
    qd: Any, qdd: Any, tau: Any, params: DriveParams, smoothing: float = 0.0
) -> Any:
    """Electrical power each axis draws from the DC link [W]; the module gives the equation.

    `qd` [rad/s], `qdd` [rad/s^2] and `tau` [Nm, armature included] are numpy arrays (..., n) or
    CasADi columns (n, 1); the result has their shape: sum it over the axes for the robot.
    A joint slower than `REST_RAD_S` stands still.

    `smoothing` [rad/s] > 0 replaces sgn(qd) by tanh(qd / smoothing), |qd| by qd tanh(qd/smoothing),
    |i| by sqrt(i^2 + e^2) - e with e = 5 A s/rad smoothing, and |qd|^0.5 by
    (qd^2 + smoothing^2)^0.25, so that gradients and Hessians exist everywhere; 0 is the exact
    model, and 0.01 to 0.05 suits optimisation.
    """
    symbolic = any(isinstance(x, (ca.SX, ca.MX, ca.DM)) for x in (qd, qdd, tau))
    lib: Any = ca if symbolic else np
    p = _Columns(params, symbolic)
    if smoothing > 0:
        sign = lib.tanh(qd / smoothing)
        root = (qd**2 + smoothing**2) ** 0.25
    else:
        # Round-off of a joint at rest has a sign too, but no friction.
        sign = lib.sign(qd) * (lib.fabs(qd) >= REST_RAD_S)
        root = lib.sqrt(lib.fabs(qd))
    gear_torque = (
        tau
        + p.extra_inertia_kg_m2 * qdd
        + (p.coulomb_nm + p.root_friction_nm_s * root) * sign
        + p.viscous_nm_s * qd
    )
    current = gear_torque / (p.gear_ratio * p.torque_constant_nm_a)
    motor_speed = p.gear_ratio * qd
    if smoothing > 0:
        width = 5.0 * smoothing
        abs_current = lib.sqrt(current**2 + width**2) - width
    else:
        abs_current = lib.fabs(current)
    return (
        gear_torque * qd
        + (p.copper_ohm + p.inverter_ohm) * current**2
        + p.eddy_w_s2 * motor_speed**2
        + p.hysteresis_w_s * motor_speed * sign
        + p.inverter_v * abs_current
        + p.idle_w
    )


class _Columns:
    """The fields as numpy rows or CasADi columns."""

    def __init__(self, params: DriveParams, symbolic: bool) -> None:
        for name in array_fields():
            value = getattr(params, name)
            setattr(self, name, ca.DM(value) if symbolic else value)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)


def drive_from_mapping(
    data: Mapping[str, Any], num_joints: int, provenance: Mapping[str, str] | None = None
) -> DriveParams:
    """`DriveParams` from the `drive:` mapping of a robot.yaml.

    A scalar means the same value for every joint; absent losses are 0. `class: ur | heavy` starts
    from that class's set instead and overrides single fields. Raises `RobotError` naming unknown,
    missing and illegal fields, all at once.
    """
    names = array_fields()
    extra = sorted(set(data) - set(names) - {"base_power_w", "class"})
    faults = [
        Fault("drive-field", "", f"drive.{key}", key, ", ".join((*names, "base_power_w", "class")))
        for key in extra
    ]
    base: dict[str, Any] = {}
    tags: dict[str, str] = {}
    if "class" in data:
        makers = {"ur": ur_class_drive, "heavy": heavy_class_drive}
        if data["class"] not in makers:
            faults.append(Fault("drive-class", "", "drive.class", str(data["class"]), "ur | heavy"))
        else:
            start = makers[data["class"]](num_joints)
            base, tags = start.to_dict(), dict(start.provenance)
    else:
        faults += [
            Fault("drive-missing", "", f"drive.{key}", "nothing", "> 0", f"give {key}, or class")
            for key in _REQUIRED
            if key not in data
        ]
    if faults:
        raise RobotError(faults)
    for name in (*names, "base_power_w"):
        value = data.get(name, base.get(name, 0.0))
        if name != "base_power_w" and np.ndim(value) == 0:
            value = [value] * num_joints
        base[name] = value
    try:
        arrays = {name: np.asarray(base[name], dtype=float) for name in names}
        power = float(base["base_power_w"])
    except (TypeError, ValueError) as error:
        raise RobotError.of("drive-value", "", "drive", str(error), "numbers") from error
    if any(value.shape != (num_joints,) for value in arrays.values()):
        wrong = [name for name, value in arrays.items() if value.shape != (num_joints,)]
        raise RobotError(
            [Fault("drive-size", "", f"drive.{n}", "", f"{num_joints} numbers") for n in wrong]
        )
    tags |= {key: tag for key, tag in (provenance or {}).items() if key in base}
    return DriveParams(**arrays, base_power_w=power, provenance=tags)


_AURT = "published: Universal Robots factory calibration of a UR5e as printed by aurt"


def ur_class_drive(num_joints: int = 6) -> DriveParams:
    """Drive of a collaborative arm with strain-wave gears, ratio 101, on a 48 V bus.

    The first three joints (shoulder and elbow) have the UR5e's size-3 motor, the others its size-1
    motor. k_t, R and friction are published for the UR5e; the inverter is assumed. The
    q-axis current is an amplitude, hence copper = 1.5 R.
    """
    is_large = np.arange(num_joints) < 3

    def pick(big: float, small: float) -> np.ndarray:
        return np.where(is_large, big, small)

    return DriveParams(
        gear_ratio=pick(101.0, 101.0),
        torque_constant_nm_a=pick(0.1005, 0.080),
        copper_ohm=1.5 * pick(0.18, 1.02),
        coulomb_nm=pick(7.0, 1.6),
        viscous_nm_s=pick(4.1, 0.85),
        root_friction_nm_s=pick(0.0, 0.0),
        eddy_w_s2=pick(2e-5, 1e-5),
        hysteresis_w_s=pick(4e-3, 2e-3),
        inverter_v=pick(0.4, 0.4),
        inverter_ohm=pick(0.02, 0.02),
        idle_w=pick(1.0, 0.5),
        extra_inertia_kg_m2=pick(0.0, 0.0),
        base_power_w=36.0,
        provenance={
            "gear_ratio": _AURT,
            "torque_constant_nm_a": _AURT,
            "copper_ohm": _AURT,
            "coulomb_nm": _AURT,
            "viscous_nm_s": _AURT,
            "base_power_w": "published: fitted to measured UR3e DC power, RAD data set (DSN 2022)",
            "root_friction_nm_s": "assumed",
            "eddy_w_s2": "assumed",
            "hysteresis_w_s": "assumed",
            "inverter_v": "assumed",
            "inverter_ohm": "assumed",
            "idle_w": "assumed",
            "extra_inertia_kg_m2": "assumed",
        },
    )


def heavy_class_drive(num_joints: int = 6) -> DriveParams:
    """Drive of a 200 kg-class industrial arm on a 560 V DC link.

    Gear ratios, motor constants and losses are assumed, of the order of magnitude of such arms;
    only the constant consumption (bus off: 153-185 W) is published.
    """
    first = np.array([180.0, 220.0, 190.0, 130.0, 130.0, 90.0])
    kt = np.array([1.45, 1.45, 1.30, 0.85, 0.85, 0.80])
    ohm = np.array([0.30, 0.30, 0.33, 0.70, 0.70, 0.90])
    coulomb = np.array([110.0, 140.0, 90.0, 35.0, 30.0, 15.0])
    viscous = np.array([75.0, 85.0, 60.0, 14.0, 11.0, 5.0])
    index = np.minimum(np.arange(num_joints), 5)
    assumed = dict.fromkeys(array_fields(), "assumed")
    return DriveParams(
        gear_ratio=first[index],
        torque_constant_nm_a=kt[index],
        copper_ohm=3.0 * ohm[index],
        coulomb_nm=coulomb[index],
        viscous_nm_s=viscous[index],
        root_friction_nm_s=np.zeros(num_joints),
        eddy_w_s2=np.array([8e-4, 8e-4, 7e-4, 2e-4, 2e-4, 2e-4])[index],
        hysteresis_w_s=np.array([0.12, 0.12, 0.10, 0.05, 0.05, 0.04])[index],
        inverter_v=np.full(num_joints, 1.8),
        inverter_ohm=np.full(num_joints, 0.05),
        idle_w=np.full(num_joints, 6.0),
        extra_inertia_kg_m2=np.zeros(num_joints),
        base_power_w=170.0,
        provenance={
            **assumed,
            "base_power_w": "published: CTU Skoda robotic cell, bus-off power 153-185 W",
        },
    )
