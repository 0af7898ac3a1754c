"""A motion does not depend on the motions that were solved before it in the same process."""

from __future__ import annotations

import subprocess
import sys
import textwrap

PROGRAM = textwrap.dedent(
    """
    import hashlib, sys
    import numpy as np
    from dmoc import Cost, MotionProblem, load_robot, solve
    robot = load_robot("irb6640_class")
    rng = np.random.default_rng(5)
    span = np.clip(robot.q_upper_rad, 0.0, 1.2)
    low = np.clip(robot.q_lower_rad, -1.2, 0.0)
    ends = [(rng.uniform(low, span), rng.uniform(low, span)) for _ in range(8)]
    order = range(8) if sys.argv[1] == "forward" else range(7, -1, -1)
    digest = {}
    for k in order:
        motion = solve(MotionProblem(robot, *ends[k], Cost(), num_intervals=20))
        digest[k] = hashlib.sha256(motion.trajectory.q_rad.tobytes()).hexdigest()
    print([digest[k] for k in range(8)])
    """
)


def test_forward_and_backward_give_the_same_bytes() -> None:
    outputs = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM, order], capture_output=True, text=True, check=True
        ).stdout
        for order in ("forward", "backward")
    ]
    assert outputs[0] == outputs[1]
    assert len(outputs[0]) > 8 * 64
