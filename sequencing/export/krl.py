"""KRL (KUKA): spline blocks through few points with a time for each part, in degrees."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from sequencing.export.program import Program, load_of, tip_of, world_of
from sequencing.export.wording import TIMED, header_lines, point_to_point, program_name

#: Kept by the plant: written where it is not there.
WELD_FILE = """\
DEF dm_weld(stud :IN, seconds :IN)
; Yours to fill; an export never writes over this file. Stud number and the planned time [s].
INT stud
REAL seconds
  WAIT SEC seconds
END
"""


def krl_program(program: Program) -> str:
    """One .src file. A motion is one PTP_SPLINE whose TIME_BLOCK holds its duration."""
    run = program.run

    def axes(degrees: Array) -> str:
        slides = program.controller.slides
        parts = [f"A{j} {x:.6f}" for j, x in enumerate(degrees[~slides], 1)]
        parts += [f"E{j} {x:.6f}" for j, x in enumerate(degrees[slides], 1)]
        return "{" + ", ".join(parts) + "}"

    def moves(key: str, _: object) -> list[str]:
        found = program.targets[key]
        part = f"    TIME_BLOCK PART = {100 / len(found.times_s):.6f}"
        lines = ["  PTP_SPLINE", "    TIME_BLOCK START"]
        for degrees in program.controller.degrees(found.q_rad[1:]):
            lines += [f"    SPTP {axes(degrees)}", part]
        lines[-1] = f"    TIME_BLOCK END = {found.times_s.sum():.6f}"
        return [*lines, "  ENDSPLINE"]

    mass, centre, turn, moments = load_of(program.robot, program.controller)
    x, y, z = moments
    body = [
        "  BAS (#INITMOV, 0)",
        "  BAS (#PTP_PARAMS, 20)",
        f"  $TOOL = {_frame(tip_of(program.robot, program.controller))}",
        f"  $BASE = {_frame(world_of(program.robot, program.controller))}",
        f"  $LOAD = {{M {mass:.4f}, CM {_frame(pin.SE3(turn, centre))}, "
        f"J {{X {x:.4f}, Y {y:.4f}, Z {z:.4f}}}}}",
        *point_to_point(
            run,
            "  ;",
            lambda q: f"  PTP {axes(program.controller.degrees(q))}",
            moves,
            lambda weld: f"  dm_weld({program.numbers[weld.stud]}, {weld.time_s:.3f})",
        ),
    ]
    name = program_name(run.name, "KRL")
    head = [f"; {line}" for line in (*header_lines(run, TIMED), *program.head())]
    return "\n".join([f"DEF {name}( )", *head, *body, "END"]) + "\n"


def _frame(pose: pin.SE3) -> str:
    """Millimetres and A, B, C [deg] about Z, Y', X''."""
    x, y, z = 1000 * pose.translation
    c, b, a = np.degrees(pin.rpy.matrixToRpy(pose.rotation))
    return f"{{X {x:.4f}, Y {y:.4f}, Z {z:.4f}, A {a:.6f}, B {b:.6f}, C {c:.6f}}}"
