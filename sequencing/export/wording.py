"""Sentences that every exported program carries, and small helpers of the program writers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import InputError
from dmoc.motion.trajectory import JointTrajectory
from sequencing.cycle_types import CycleMotion, Weld
from sequencing.runs.clock import trajectory_of
from sequencing.runs.folder import Run

TIMED = (
    "Few targets with a time for each stretch: as modelled (see the head) they keep the planned "
    "path and timing; a controller that blends otherwise changes torques and energy. "
    "Point-to-point execution without these times does NOT preserve the planned torques."
)
CUBIC = (
    "The knots of the plan as data, evaluated as a cubic on every control step: the planned "
    "timing. The controller's own filtering (lookahead, gain) still changes torques a little. "
    "Point-to-point execution of the same knots would not preserve the torque timing."
)
STREAMED = (
    "Streamed export keeps the planned timing up to the sampling step; the controller's own "
    "filtering (lookahead, gain) still changes torques a little. Point-to-point export of the same "
    "points would not preserve the torque timing."
)


def header_lines(run: Run, statement: str) -> list[str]:
    """Plain lines for the head of a program; ASCII only, as old controllers want it."""
    assumed = sorted(k for k, tag in run.result["robot"]["provenance"].items() if tag == "assumed")
    lines = [
        f"Station {run.name}, robot {run.result['robot']['name']}, seed {run.result['seed']}",
        f"Station fingerprint {run.result['inputs']['station_fingerprint']}",
        f"{len(run.motions)} motions, {run.result['certified']} certified free of collision",
        statement,
    ]
    if assumed:
        lines.append("Planned with assumed values: " + ", ".join(assumed))
    return [ascii_text(line) for line in lines]


def ascii_text(text: str) -> str:
    """One line of printable ASCII: a name from a file cannot end a comment and begin a command."""
    plain = text.replace("→", "->").encode("ascii", "replace").decode("ascii")
    return "".join(c if c.isprintable() else "?" for c in plain)


def title(item: CycleMotion) -> str:
    """`m000 S01 -> S07`, fit for a comment."""
    return ascii_text(f"{item.key} {item.origin} -> {item.target}")


#: Longest name of a program, and words that name none: those of the language, and programs and
#: functions that every controller has.
_LANGUAGES: dict[str, tuple[int, frozenset[str]]] = {}
for _language, _longest, _words in (
    (
        "RAPID",
        28,
        "alias and backward base case connect const default div do else elseif endfor endfunc "
        "endif endmodule endproc endrecord endtest endtrap endwhile error exit false for from "
        "func goto if inout local main mod module nostepin not noview or pers proc raise "
        "readonly record retry return step sysmodule task test then to trap true trynext undo "
        "user var viewonly while with xor",
    ),
    (
        "KRL",
        24,
        "and anin anout axis b_and b_exor b_not b_or bas bas_ext bool brake c_dis c_ori c_ptp "
        "c_spl c_vel case cast_from cast_to ccomp cell channel char circ circ_rel confirm "
        "const const_key continue decl def default defdat deffct delay div do e6axis e6pos "
        "else end enddat endfct endfor endif endloop endspline endswitch endwhile enum error "
        "exit exor ext extfct extp false for frame geo global goto halt if imp import int "
        "interrupt inv_pos ir_stopm is label lin lin_rel loop maximum minimum mod not or p00 "
        "peri pos prio private ptp ptp_rel public pulse real repeat resume return scirc sec "
        "seq signal slin spl spline sps sptp step struc switch then time_block to trigger "
        "true until wait when while with_block",
    ),
    (
        "URScript",
        40,
        "abs and break ceil continue cos def elif else end enter_critical exit_critical false "
        "floor for force_mode freedrive_mode get_actual_joint_positions get_inverse_kin "
        "global halt if in join kill local log loop mod movec movej movel movep none norm not "
        "or pass popup pow random return run sec servoc servoj set_payload set_tcp sin sleep "
        "speedj speedl sqrt stopj stopl struct sync tan textmsg thread true until while xor",
    ),
):
    _LANGUAGES[_language] = (_longest, frozenset(_words.split()))


def program_name(text: str, language: str) -> str:
    """The name of a program and of its file: letters, digits, underscores, a letter first, no word
    of the language, not longer than its controllers take, and none of our own (dm_…)."""
    longest, reserved = _LANGUAGES[language]
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    if not name[:1].isalpha() or name.lower() in reserved or name.lower().startswith("dm_"):
        name = "P_" + name
    name = name[:longest]
    # What is left of a long name could be a word again.
    return "P_" + name if name.lower() in reserved else name


def six_joints(run: Run, language: str) -> None:
    """Refuse a robot that does not have the six turning joints that `language` can name, and at
    most a track where it has external axes."""
    tracks = 0 if run.robot is None else int(run.robot.slides.sum())
    if len(run.joint_names) - tracks != 6 or (tracks and language == "URScript"):
        raise InputError.of(
            "export-joints",
            file=str(run.folder),
            field="robot.joint_names",
            value=str(len(run.joint_names)),
            legal=f"6 turning joints for {language}"
            + ("" if language == "URScript" else ", and a track"),
            fix="use csv or ros for other arms",
        )


def steps(run: Run) -> Iterator[tuple[CycleMotion, JointTrajectory] | Weld]:
    """Motions (with their trajectories) and welds in order of execution."""
    line = run.timeline
    for segment in line.segments:
        if segment.kind == "weld":
            yield line.welds[segment.index]
        else:
            item = line.motions[segment.index]
            yield item, trajectory_of(item)


def point_to_point(
    run: Run,
    comment: str,
    first_move: Callable[[Array], str],
    moves: Callable[[str, JointTrajectory], list[str]],
    weld: Callable[[Weld], str],
    after: Sequence[str] = (),
) -> list[str]:
    """Body of a program of single moves: to the first pose, then motions and welds in order.

    `first_move` writes the move to a pose, `moves` those of a motion's key and trajectory;
    `comment` begins a comment, `weld` calls the plant's routine, and `after` follows every motion.
    """
    body: list[str] = []
    for step in steps(run):
        if isinstance(step, Weld):
            if not body:
                body.append(first_move(step.q_rad))
            body += [f"{comment} weld {ascii_text(step.stud)}", weld(step)]
            continue
        item, trajectory = step
        if not body:
            body.append(first_move(trajectory.q_rad[0]))
        body += [
            f"{comment} motion {title(item)}",
            *moves(item.key, trajectory),
            f"{comment} end {item.key}",
        ]
        body += after
    return body


def sampled(trajectory: JointTrajectory, step_s: float) -> tuple[Array, float]:
    """Joint vectors (K, n) every `step_s` from one step after the start to the goal, and the
    largest deviation [rad] of the straight lines between them from the curve.

    The last step is shorter in the plan than in the program: the goal is held for the rest.
    """
    start, length = trajectory.t_s[0], trajectory.duration_s
    count = max(1, int(np.ceil(length / step_s - 1e-9)))
    times = np.minimum(np.arange(count + 1) * step_s, length)
    points = trajectory.sample(start + times).q_rad
    fine = np.linspace(0.0, length, 8 * count + 1)
    curve = trajectory.sample(start + fine).q_rad
    # In the program the last point comes a full step after the one before it.
    program = np.arange(count + 1) * step_s
    lines = [np.interp(fine, program, column) for column in points.T]
    return points[1:], float(np.max(np.abs(np.column_stack(lines) - curve)))
