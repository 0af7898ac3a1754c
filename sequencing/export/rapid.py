"""RAPID (ABB): the knots of the cycle as MoveAbsJ, in degrees."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory
from sequencing.export.wording import (
    POINT_TO_POINT,
    header_lines,
    point_to_point,
    program_name,
    six_joints,
)
from sequencing.runs.folder import Run

_NO_AXES = "[9E9,9E9,9E9,9E9,9E9,9E9]"


def rapid_program(run: Run) -> str:
    r"""One module with one procedure; every move carries the planned time of its stretch in `\T`.

    Points between are fly-by (z1), weld poses exact (fine). Even with `\T` the controller chooses
    speeds inside a stretch, so torques are not preserved.
    """
    six_joints(run, "RAPID")
    body = point_to_point(
        run,
        "    !",
        lambda q: f"    MoveAbsJ {_target(q)}\\NoEOffs, v200, fine, tool0;",
        _moves,
        "    WaitTime {:.3f};",
    )
    name = program_name(run.name, "RAPID")
    head = [f"  ! {line}" for line in header_lines(run, POINT_TO_POINT)]
    return (
        "\n".join(
            [f"MODULE {name}", *head, f"  PROC run_{name[:24]}()", *body, "  ENDPROC", "ENDMODULE"]
        )
        + "\n"
    )


def _moves(trajectory: JointTrajectory) -> list[str]:
    lengths = np.diff(trajectory.t_s)
    zones = ["z1"] * (len(lengths) - 1) + ["fine"]
    return [
        f"    MoveAbsJ {_target(q)}\\NoEOffs, v1000\\T:={seconds:.4f}, {zone}, tool0;"
        for q, seconds, zone in zip(trajectory.q_rad[1:], lengths, zones)
    ]


def _target(q_rad: Array) -> str:
    degrees = ",".join(f"{x:.6f}" for x in np.degrees(q_rad))
    return f"[[{degrees}],{_NO_AXES}]"
