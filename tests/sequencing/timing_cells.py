"""Small cells of two arms for the timing tests."""

import itertools

import numpy as np
import pinocchio as pin

from dmoc.curves.trapezoid import trapezoid_motion
from dmoc.robot.robot import load_robot
from sequencing.timing.cell.read import Cell, CellRobot
from sequencing.timing.power.dc_link import LinkParams

ARM = load_robot("ur10e_class")


def two_arms(
    left: np.ndarray,
    right: np.ndarray,
    apart_m: float = 6.0,
    handovers: tuple[tuple[int, int], ...] = (),
    free_order: tuple[bool, bool] = (False, False),
    capacitance_f: float = 2e-4,
    facing: bool = False,
    clearance_m: float = 0.01,
) -> Cell:
    """Two arms `apart_m` apart that run trapezoids through the joint vectors given (K, 6)."""
    robots = []
    for name, stops, x, free in zip(
        ("left", "right"), (left, right), (0.0, apart_m), free_order, strict=True
    ):
        turn = pin.utils.rotate("z", np.pi) if facing and name == "right" else np.eye(3)
        arm = ARM.with_base(pin.SE3(turn, np.array([x, 0.0, 0.0])))
        motions = tuple(trapezoid_motion(arm, a, b) for a, b in itertools.pairwise(stops))
        count = len(motions)
        robots.append(
            CellRobot(
                name,
                arm,
                (),
                motions,
                (arm,) * count,
                ("",) * count,
                (0.0,) * count,
                free_order=free,
            )
        )
    link = LinkParams(capacitance_f=capacitance_f)
    return Cell("two-arms", tuple(robots), (), handovers, (link,), (0, 0), 0.0, clearance_m)


def stops(seed: int, count: int, reach_rad: float = 1.0) -> np.ndarray:
    """Random joint vectors (count, 6) around an upright arm."""
    rng = np.random.default_rng(seed)
    middle = np.array([0.0, -1.4, 0.8, -0.8, 0.3, 0.0])
    return middle + rng.uniform(-reach_rad, reach_rad, (count, 6)) * [1, 0.4, 0.4, 1, 1, 1]


def round_trips(seed: int, jobs: int) -> np.ndarray:
    """Joint vectors of `jobs` trips from one home and back, each through one place."""
    home, *places = stops(seed, jobs + 1)
    return np.array([home, *itertools.chain(*([place, home] for place in places))])


def reaching(times: int) -> np.ndarray:
    """Joint vectors of an upright arm that reaches forward to one side and back, `times` times."""
    up = np.array([0.0, -1.57, 0.0, 0.0, 0.0, 0.0])
    rows = [up]
    for k in range(times):
        out, back = up.copy(), up.copy()
        out[:2] = np.pi + (-1) ** k * 1.2, -0.3
        back[:2], back[5] = (np.pi, -1.5), 0.1 * k
        rows += [out, back]
    return np.array(rows)
