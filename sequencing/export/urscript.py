"""URScript: the cycle as a stream of servoj commands."""

from __future__ import annotations

from dmoc.motion.trajectory import JointTrajectory
from sequencing.export.wording import (
    STREAMED,
    header_lines,
    point_to_point,
    program_name,
    sampled,
    six_joints,
)
from sequencing.runs.folder import Run

# servoj's own ranges: lookahead 0.03-0.2 s, gain 100-2000 (URScript manual, e-Series).
_LOOKAHEAD_S, _GAIN = 0.1, 300


def urscript_program(run: Run, step_s: float) -> tuple[str, float]:
    """The program and its largest deviation [rad] from the plan, streamed every `step_s`."""
    six_joints(run, "URScript")
    name = program_name(run.name, "URScript")
    command = f", t={step_s:g}, lookahead_time={_LOOKAHEAD_S:g}, gain={_GAIN})"
    deviations = [0.0]

    def moves(trajectory: JointTrajectory) -> list[str]:
        points, deviation = sampled(trajectory, step_s)
        deviations.append(deviation)
        return [f"  servoj({_vector(q)}{command}" for q in points]

    body = point_to_point(
        run,
        "  #",
        lambda q: f"  movej({_vector(q)}, a=0.5, v=0.3)  # go to the start",
        moves,
        "  sleep({:.6f})",
        after=["  stopj(2.0)"],
    )
    worst = max(deviations)
    head = [f"# {line}" for line in header_lines(run, STREAMED)]
    head.append(
        f"# Sampled every {1000 * step_s:g} ms: straight lines between the points deviate from the "
        f"planned curve by at most {worst:.3e} rad."
    )
    return "\n".join([*head, f"def {name}():", *body, "end", f"{name}()"]) + "\n", worst


def _vector(q_rad: object) -> str:
    return "[" + ", ".join(f"{x:.8f}" for x in q_rad) + "]"  # type: ignore[attr-defined]
