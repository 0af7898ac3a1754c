"""RAPID (ABB): the knots of the cycle as MoveAbsJ, in degrees."""

from __future__ import annotations

import numpy as np

from dmoc.arrays import Array
from sequencing.cycle_types import Weld
from sequencing.export.wording import (
    POINT_TO_POINT,
    ascii_text,
    header_lines,
    identifier,
    six_joints,
    steps,
    title,
)
from sequencing.run_files import Run

_NO_AXES = "[9E9,9E9,9E9,9E9,9E9,9E9]"


def rapid_program(run: Run) -> str:
    r"""One module with one procedure; every move carries the planned time of its stretch in `\T`.

    Points between are fly-by (z1), weld poses exact (fine). Even with `\T` the controller chooses
    speeds inside a stretch, so torques are not preserved.
    """
    six_joints(run, "RAPID")
    body: list[str] = []
    first = True
    for step in steps(run):
        if isinstance(step, Weld):
            if first:
                body.append(f"    MoveAbsJ {_target(step.q_rad)}\\NoEOffs, v200, fine, tool0;")
            body += [f"    ! weld {ascii_text(step.stud)}: start the process here",
                     f"    WaitTime {step.time_s:.3f};"]  # fmt: skip
            first = False
            continue
        item, trajectory = step
        if first:
            body.append(f"    MoveAbsJ {_target(trajectory.q_rad[0])}\\NoEOffs, v200, fine, tool0;")
        first = False
        body.append(f"    ! motion {title(item)}")
        lengths = np.diff(trajectory.t_s)
        for k, (q, seconds) in enumerate(zip(trajectory.q_rad[1:], lengths)):
            zone = "fine" if k + 1 == len(lengths) else "z1"
            body.append(
                f"    MoveAbsJ {_target(q)}\\NoEOffs, v1000\\T:={seconds:.4f}, {zone}, tool0;"
            )
        body.append(f"    ! end {item.key}")
    name = identifier(run.name, 28)
    head = [f"  ! {line}" for line in header_lines(run, POINT_TO_POINT)]
    return "\n".join(
        [f"MODULE {name}", *head, f"  PROC run_{name[:24]}()", *body, "  ENDPROC", "ENDMODULE"]
    ) + "\n"  # fmt: skip


def _target(q_rad: Array) -> str:
    degrees = ",".join(f"{x:.6f}" for x in np.degrees(q_rad))
    return f"[[{degrees}],{_NO_AXES}]"
