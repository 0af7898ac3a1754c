"""Two robots on one DC link: the energy that one gives back while braking drives the other."""

import numpy as np
import pinocchio as pin

from dmoc import MotionProblem, load_robot, solve
from sequencing import schedule
from sequencing.timing.cell.types import Cell, CellRobot
from sequencing.timing.power.dc_link import LinkParams
from sequencing.timing.search.optimise import SearchParams


def robot_at(name: str, y_m: float) -> CellRobot:
    """An arm that swings over and back, with half a second of rest after each."""
    robot = load_robot("irb6640_class").with_base(pin.SE3(np.eye(3), np.array([0.0, y_m, 0.0])))
    here, there = np.array([-0.6, 0.1, 0.2, 0, 0.5, 0]), np.array([0.6, 0.5, -0.1, 0, 0.5, 0])
    motions = [solve(MotionProblem(robot, *ends)) for ends in ((here, there), (there, here))]
    paths = tuple(motion.require().trajectory for motion in motions)
    return CellRobot(name, robot, (), paths, (robot, robot), ("over", "back"), (0.5, 0.5))


cell = Cell(
    name="pair",
    robots=(robot_at("left", 0.0), robot_at("right", 8.0)),
    obstacles=(),
    handovers=((0, 2),),  # the right one starts when the left one has swung over
    links=(LinkParams(capacitance_f=10e-3),),
    link_of=(0, 0),
    base_load_w=0.0,
    clearance_m=0.05,
)
few = SearchParams(scattered=40, gradient_starts=1, gradient_iterations=10, polish_rounds=2)
for case in schedule(cell, seed=0, params=few).cases:
    print(f"{case.name:22} {case.energy_j:8.0f} J  {case.timing.total_s:.2f} s")
