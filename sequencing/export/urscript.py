"""URScript: the knots with a cubic evaluated on every control step, or a stream of servoj."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory
from sequencing.export.program import Program, load_of, tip_of
from sequencing.export.wording import (
    CUBIC,
    STREAMED,
    header_lines,
    point_to_point,
    program_name,
    sampled,
)

# servoj's own ranges: lookahead 0.03-0.2 s, gain 100-2000 (URScript manual, e-Series).
_LOOKAHEAD_S, _GAIN = 0.1, 300
_SERVO = f"lookahead_time={_LOOKAHEAD_S:g}, gain={_GAIN})"
#: Kept by the plant and put into the program: written where it is not there.
WELD_FUNCTION = """\
# Yours to fill; an export never writes over this file. Stud number and the planned time [s].
def dm_weld(stud, seconds):
  sleep(seconds)
end
"""
_FOLLOW = f"""\
  # One interval of a cubic from its ends and their speeds; t is the time since it began.
  def dm_cubic(q0, v0, q1, v1, seconds, t):
    local h = get_steptime()
    while t < seconds:
      local s = t / seconds
      local q = [0, 0, 0, 0, 0, 0]
      local j = 0
      while j < 6:
        local d = q1[j] - q0[j]
        local a = v0[j] * seconds
        local b = v1[j] * seconds
        q[j] = q0[j] + s * (a + s * (3 * d - 2 * a - b + s * (a + b - 2 * d)))
        j = j + 1
      end
      servoj(q, t=h, {_SERVO}
      t = t + h
    end
    return t - seconds
  end
"""


def urscript_program(program: Program, weld: str, step_s: float | None) -> tuple[str, float]:
    """The program and its largest deviation [rad] from the plan.

    Without `step_s` the controller evaluates the plan's cubics itself; with it the joints are
    streamed at that step. `weld` is the text of the plant's dm_weld.
    """
    run, controller = program.run, program.controller
    name = program_name(run.name, "URScript")
    still = controller.degrees(np.zeros(len(run.joint_names)))
    deviations = [0.0]

    def vector(q_rad: Array) -> str:
        return _vector(np.radians(controller.degrees(q_rad)))

    def speeds(v: Array) -> str:
        return _vector(np.radians(controller.degrees(v) - still))

    def streamed(_: str, trajectory: JointTrajectory) -> list[str]:
        points, deviation = sampled(trajectory, step_s or 1.0)
        deviations.append(deviation)
        return [f"  servoj({vector(q)}, t={step_s:g}, {_SERVO}" for q in points]

    def cubics(_: str, trajectory: JointTrajectory) -> list[str]:
        lines, q, v = ["  dm_t = get_steptime()"], trajectory.q_rad, trajectory.velocity_rad_s
        for k, seconds in enumerate(np.diff(trajectory.t_s)):
            ends = f"{vector(q[k])}, {speeds(v[k])}, {vector(q[k + 1])}, {speeds(v[k + 1])}"
            lines.append(f"  dm_t = dm_cubic({ends}, {seconds:.9f}, dm_t)")
        return [*lines, f"  servoj({vector(q[-1])}, t=get_steptime(), {_SERVO}"]

    body = point_to_point(
        run,
        "  #",
        lambda q: f"  movej({vector(q)}, a=0.5, v=0.3)  # go to the start",
        cubics if step_s is None else streamed,
        lambda item: f"  dm_weld({program.numbers[item.stud]}, {item.time_s:.6f})",
        after=["  stopj(2.0)"],
    )
    worst = max(deviations)
    lines = [*header_lines(run, CUBIC if step_s is None else STREAMED), *program.head()]
    if step_s is not None:
        lines.append(
            f"Sampled every {1000 * step_s:g} ms: straight lines between the points deviate from "
            f"the planned curve by at most {worst:.3e} rad."
        )
    mass, centre, *_ = load_of(program.robot, controller)
    tip = tip_of(program.robot, controller)
    pose = _vector([*tip.translation, *pin.log3(tip.rotation)])
    text = [
        *(f"# {line}" for line in lines),
        f"def {name}():",
        *(f"  {line}" for line in weld.splitlines()),
        *(_FOLLOW.splitlines() if step_s is None else ()),
        f"  set_tcp(p{pose})",
        f"  set_payload({mass:.4f}, {_vector(centre)})",
        *body,
        "end",
        f"{name}()",
    ]
    return "\n".join(text) + "\n", worst


def _vector(values: Array | list[float]) -> str:
    return "[" + ", ".join(f"{x:.8f}" for x in values) + "]"
