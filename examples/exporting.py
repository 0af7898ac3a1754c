"""Motions without a station as a run folder, and from it programs for controllers."""

import numpy as np

from dmoc import Cost, MotionProblem, load_robot, solve
from sequencing.cycle_types import CycleMotion
from sequencing.export.exporting import EXPORT_FORMATS, export_run
from sequencing.runs.folder import write_motions

robot = load_robot("ur10e_class")
stops = np.array([[0.0, -1.6, 1.4, -1.2, -1.5, 0.0], [0.8, -1.3, 1.1, -1.2, -1.5, 0.0]])

there = solve(MotionProblem(robot, *stops)).require()
back = solve(MotionProblem(robot, *stops[::-1])).require()
items = [
    CycleMotion("m000", "pick", "place", "travel", there),
    CycleMotion("m001", "place", "pick", "travel", back),
]
run = write_motions("pick and place", robot, items, Cost(), "run", seed=0)

for name in EXPORT_FORMATS:
    export = export_run(run, name, "programs")
    print(f"{name:9} {export.files[0].name:28} {export.statement.splitlines()[0][:60]}")
