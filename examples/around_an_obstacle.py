"""A motion round a post: first where it would go freely, then with a proof of clearance."""

import numpy as np

from dmoc import MotionProblem, load_robot
from planning import plan_motion
from planning.collision.world import world_for
from planning.geometry.shapes import Body, Shape, pose_matrix

robot = load_robot("ur10e_class")
post = Body("post", (Shape("box", (0.1, 0.1, 0.5)),), pose=pose_matrix((-0.84, -0.27, 0.25)))
world = world_for(robot, obstacles=(post,), clearance_m=0.02)
clearance = world.clearance()

start = np.array([-0.7, -1.2, 1.6, -1.9, -1.5, 0.0])
goal = np.array([0.9, -1.2, 1.6, -1.9, -1.5, 0.0])
problem = MotionProblem(robot, start, goal, num_intervals=20)

free = plan_motion(problem, clearance, world, seed=0, method="none")
print(f"free: J = {free.cost:.2f}, {1e3 * free.min_clearance_m:.0f} mm from the nearest body")

# `solver`, `planner` and `method` say who made a motion.
motion = plan_motion(problem, clearance, world, seed=0).require()
print(f"round: J = {motion.cost:.2f}, proven to keep {1e3 * motion.proven_clearance_m:.1f} mm")
print(f"by {motion.solver}, seed path by {motion.planner}, {motion.method}")
