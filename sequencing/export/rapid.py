"""RAPID (ABB): few MoveAbsJ with half zones and a time for each stretch, in degrees."""

from __future__ import annotations

import pinocchio as pin

from dmoc.arrays import Array
from sequencing.export.program import Program, load_of, tip_of, world_of
from sequencing.export.wording import TIMED, header_lines, point_to_point, program_name

_HOW = "\\NoEOffs,"
_WITH = "dm_tool\\WObj:=dm_world;"
#: Kept by the plant: written where it is not there.
WELD_MODULE = """\
MODULE dm_welds
  ! Yours to fill; an export never writes over this file. Stud number and the planned time [s].
  PROC dm_weld(num stud, num seconds)
    WaitTime seconds;
  ENDPROC
ENDMODULE
"""


def rapid_program(program: Program) -> str:
    r"""One module with one procedure. Stretches take the time in `\T`; zones are larger than any
    stretch, so that the controller cuts them to half of it; weld poses are exact (fine).
    """
    run = program.run

    def target(degrees: Array) -> str:
        slides = program.controller.slides
        arm, track = ([f"{x:.6f}" for x in degrees[kind]] for kind in (~slides, slides))
        return f"[[{','.join(arm)}],[{','.join([*track, *['9E9'] * (6 - len(track))])}]]"

    def moves(key: str, _: object) -> list[str]:
        found = program.targets[key]
        zones = ["dm_half"] * (len(found.times_s) - 1) + ["fine"]
        angles = program.controller.degrees(found.q_rad[1:])
        return [
            f"    MoveAbsJ {target(q)}{_HOW} dm_speed\\T:={seconds:.6f}, {zone}, {_WITH}"
            for q, seconds, zone in zip(angles, found.times_s, zones)
        ]

    body = point_to_point(
        run,
        "    !",
        lambda q: (
            f"    MoveAbsJ {target(program.controller.degrees(q))}{_HOW} dm_approach, fine, {_WITH}"
        ),
        moves,
        lambda weld: f"    dm_weld {program.numbers[weld.stud]}, {weld.time_s:.3f};",
    )
    name = program_name(run.name, "RAPID")
    lines = [
        f"MODULE {name}",
        *(f"  ! {line}" for line in (*header_lines(run, TIMED), *program.head())),
        *_data(program),
        f"  PROC run_{name[:24]}()",
        *body,
        "  ENDPROC",
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"


def _data(program: Program) -> list[str]:
    """Tool with its load, the station's axes as work frame, speeds and zone."""
    mass, centre, turn, moments = load_of(program.robot, program.controller)
    load = [f"{max(mass, 0.001):.4f}", _list(1000 * centre), _quaternion(turn), *_each(moments)]
    tip = _frame(tip_of(program.robot, program.controller))
    frame = _frame(world_of(program.robot, program.controller))
    return [
        f"  PERS tooldata dm_tool := [TRUE,{tip},[{','.join(load)}]];",
        f'  PERS wobjdata dm_world := [FALSE,TRUE,"",{frame},[[0,0,0],[1,0,0,0]]];',
        "  CONST speeddata dm_approach := [200,30,200,30];",
        "  CONST speeddata dm_speed := [5000,500,5000,1000];",
        "  CONST zonedata dm_half := [FALSE,5000,5000,5000,360,5000,360];",
    ]


def _frame(pose: pin.SE3) -> str:
    return f"[{_list(1000 * pose.translation)},{_quaternion(pose.rotation)}]"


def _quaternion(rotation: Array) -> str:
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return "[" + ",".join(f"{value:.9f}" for value in (w, x, y, z)) + "]"


def _each(values: Array) -> list[str]:
    return [f"{x + 0.0:.4f}" for x in values]


def _list(values: Array) -> str:
    return "[" + ",".join(_each(values)) + "]"
