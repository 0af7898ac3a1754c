"""One optimal motion between two joint vectors, and an independent simulation of it."""

import numpy as np

from dmoc import Cost, MotionProblem, load_robot, replay_motion, solve

robot = load_robot("ur10e_class")
start = np.array([0.0, -1.6, 1.4, -1.2, -1.5, 0.0])
goal = np.array([1.2, -1.1, 0.9, -1.2, -1.5, 0.4])

# J = time + effort · torque² + velocity · speed², integrated over a duration that is free itself.
cost = Cost(time=1.0, effort=1e-4, velocity=1.0)
motion = solve(MotionProblem(robot, start, goal, cost, num_intervals=20)).require()

# The solver does not judge itself: the torques drive a simulation of the continuous equations.
replayed = replay_motion(motion, cost)
print(f"{motion.duration_s:.3f} s, J = {motion.cost:.3f}, {motion.iterations} iterations")
print(f"simulated: joints off by at most {replayed.replay_error_rad:.1e} rad")
