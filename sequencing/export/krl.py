"""KRL (KUKA): the knots of the cycle as PTP, in degrees."""

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


def krl_program(run: Run) -> str:
    """One .src file. Points between are approximated (C_PTP), weld poses exact."""
    six_joints(run, "KRL")
    body = [
        "  BAS (#INITMOV, 0)",
        "  $APO.CPTP = 1",
        *point_to_point(run, "  ;", lambda q: f"  PTP {_axes(q)}", _moves, "  WAIT SEC {:.3f}"),
    ]
    name = program_name(run.name, "KRL")
    head = [f"; {line}" for line in header_lines(run, POINT_TO_POINT)]
    return "\n".join([f"DEF {name}( )", *head, *body, "END"]) + "\n"


def _moves(trajectory: JointTrajectory) -> list[str]:
    moves = [f"  PTP {_axes(q)}" for q in trajectory.q_rad[1:]]
    return [*(f"{move} C_PTP" for move in moves[:-1]), moves[-1]]


def _axes(q_rad: Array) -> str:
    return "{" + ", ".join(f"A{j} {x:.6f}" for j, x in enumerate(np.degrees(q_rad), 1)) + "}"
