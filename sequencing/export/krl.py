"""KRL (KUKA): the knots of the cycle as PTP, in degrees."""

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


def krl_program(run: Run) -> str:
    """One .src file. Points between are approximated (C_PTP), weld poses exact."""
    six_joints(run, "KRL")
    body = [
        "  BAS (#INITMOV, 0)",
        "  $APO.CPTP = 1",
    ]
    first = True
    for step in steps(run):
        if isinstance(step, Weld):
            if first:
                body.append(f"  PTP {_axes(step.q_rad)}")
            body += [f"  ; weld {ascii_text(step.stud)}: start the process here",
                     f"  WAIT SEC {step.time_s:.3f}"]  # fmt: skip
            first = False
            continue
        item, trajectory = step
        if first:
            body.append(f"  PTP {_axes(trajectory.q_rad[0])}")
        first = False
        body.append(f"  ; motion {title(item)}")
        last = trajectory.num_intervals
        for k, q in enumerate(trajectory.q_rad[1:], start=1):
            body.append(f"  PTP {_axes(q)}" + ("" if k == last else " C_PTP"))
        body.append(f"  ; end {item.key}")
    name = identifier(run.name, 24)
    head = [f"; {line}" for line in header_lines(run, POINT_TO_POINT)]
    return "\n".join([f"DEF {name}( )", *head, *body, "END"]) + "\n"


def _axes(q_rad: Array) -> str:
    return "{" + ", ".join(f"A{j} {x:.6f}" for j, x in enumerate(np.degrees(q_rad), 1)) + "}"
