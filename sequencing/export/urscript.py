"""URScript: the cycle as a stream of servoj commands."""

from __future__ import annotations

from sequencing.cycle_types import Weld
from sequencing.export.wording import (
    STREAMED,
    ascii_text,
    header_lines,
    program_name,
    sampled,
    six_joints,
    steps,
    title,
)
from sequencing.runs.folder import Run

# servoj's own ranges: lookahead 0.03-0.2 s, gain 100-2000 (URScript manual, e-Series).
_LOOKAHEAD_S, _GAIN = 0.1, 300


def urscript_program(run: Run, step_s: float) -> tuple[str, float]:
    """The program and its largest deviation [rad] from the plan, streamed every `step_s`."""
    six_joints(run, "URScript")
    name = program_name(run.name, "URScript")
    body, worst, first = [], 0.0, True
    for step in steps(run):
        if isinstance(step, Weld):
            if first:
                body.append(f"  movej({_vector(step.q_rad)}, a=0.5, v=0.3)  # go to the start")
            body += [
                f"  # weld {ascii_text(step.stud)}: start the process here",
                f"  sleep({step.time_s:.6f})",
            ]
            first = False
            continue
        item, trajectory = step
        points, deviation = sampled(trajectory, step_s)
        worst = max(worst, deviation)
        if first:
            body.append(f"  movej({_vector(trajectory.q_rad[0])}, a=0.5, v=0.3)  # go to the start")
        first = False
        body.append(f"  # motion {title(item)}")
        body += [
            f"  servoj({_vector(q)}, t={step_s:g}, lookahead_time={_LOOKAHEAD_S:g}, gain={_GAIN})"
            for q in points
        ]
        body += [f"  # end {item.key}", "  stopj(2.0)"]
    head = [f"# {line}" for line in header_lines(run, STREAMED)]
    head.append(
        f"# Sampled every {1000 * step_s:g} ms: straight lines between the points deviate from the "
        f"planned curve by at most {worst:.3e} rad."
    )
    return "\n".join([*head, f"def {name}():", *body, "end", f"{name}()"]) + "\n", worst


def _vector(q_rad: object) -> str:
    return "[" + ", ".join(f"{x:.8f}" for x in q_rad) + "]"  # type: ignore[attr-defined]
