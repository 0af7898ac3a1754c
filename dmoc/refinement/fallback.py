"""The time-scaled seed path as a motion of last resort."""

from __future__ import annotations

import numpy as np

from dmoc.curves.blended_path import FreeTest
from dmoc.curves.time_scaling import TimedPath, time_scale
from dmoc.motion.clearance import Clearance
from dmoc.motion.motion import Motion, MotionProblem
from dmoc.motion.status import Status
from dmoc.motion.trajectory import JointPath
from dmoc.physics.running_cost import executed_cost

_BLEND_CLEARANCE_M = 0.005


def fallback_motion(
    problem: MotionProblem, path: JointPath, clearance: Clearance, *, note: str = ""
) -> Motion | None:
    """The time-scaled `path` if it is certified and within the limits, else None.

    First with corners blended as far as the clearance lets them, then nearly at the corners. Its
    cost is that of the inverse-dynamics torques along the interpolant. It holds no discrete
    optimality or defect; `replay_error_rad` is the error of its interpolant against the path's
    own dynamics and is left to `dmoc.replay_motion`.
    """
    tests: tuple[FreeTest, ...] = (
        lambda q: clearance.phi(q) > _BLEND_CLEARANCE_M,
        lambda q: np.zeros(len(q), dtype=bool),
    )
    for is_free in tests:
        timed = time_scale(path, problem, is_free=is_free)
        motion = _certified(problem, timed, clearance, note)
        if motion is not None:
            return motion
    return None


def _certified(
    problem: MotionProblem, timed: TimedPath, clearance: Clearance, note: str
) -> Motion | None:
    if not timed.within_limits:
        return None
    certificate = clearance.certify(timed.trajectory)
    if not certificate.ok:
        return None
    executed = executed_cost(problem, timed.trajectory)
    return Motion(
        status=Status.ACCEPTABLE,
        source="fallback",
        trajectory=timed.trajectory,
        cost=executed,
        executed_cost=executed,
        min_clearance_m=certificate.min_clearance_m,
        proven_clearance_m=certificate.proven_clearance_m,
        certified=True,
        note=f"time-scaled seed ({timed.law}); refinement: {note}" if note else "time-scaled seed",
        solver="none",
        method="time-scaled",
    )
