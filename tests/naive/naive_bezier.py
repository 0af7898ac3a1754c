"""De Casteljau's construction and plain loops: slow oracles of `bezier_motion` and the metrics."""

import numpy as np
import pinocchio as pin

from dmoc.robot.robot import Robot


def casteljau(control: np.ndarray, u: float) -> np.ndarray:
    """The curve's point at u by repeated linear interpolation."""
    points = np.array(control, dtype=float)
    while len(points) > 1:
        points = (1 - u) * points[:-1] + u * points[1:]
    return points[0]


def hodograph(control: np.ndarray) -> np.ndarray:
    """Control points of the derivative by u."""
    return (len(control) - 1) * np.diff(control, axis=0)


def energies(robot: Robot, control: np.ndarray, duration_s: float, count: int) -> dict[str, float]:
    """The three energies by midpoint sums, joint by joint, with the drive's plain fields."""
    first = hodograph(control)
    second = hodograph(first)
    drive, data = robot.drive, robot.model.createData()

    def of(name: str, j: int) -> float:
        value = drive[name]
        return float(value if np.ndim(value) == 0 else value[j])

    total = {"energy": 0.0, "iv_signed": 0.0, "iv_absolute": 0.0}
    for k in range(count):
        u = (k + 0.5) / count
        q = casteljau(control, u)
        v = casteljau(first, u) / duration_s
        a = casteljau(second, u) / duration_s**2
        tau = pin.rnea(robot.model, data, q, v, a)
        for j in range(robot.num_joints):
            gear = tau[j] + of("coulomb_nm", j) * np.sign(v[j]) + of("viscous_nm_s", j) * v[j]
            current = gear / (of("gear_ratio", j) * of("torque_constant_nm_a", j))
            power = gear * v[j] + of("copper_ohm", j) * current**2
            step = duration_s / count
            total["energy"] += step * power
            total["iv_signed"] += step * 48.0 * current
            total["iv_absolute"] += step * 48.0 * abs(current)
    return total
