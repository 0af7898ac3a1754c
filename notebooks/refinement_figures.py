# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Collision-free refinement, drawn
#
# Figures 1 and 2 of Björkenstam et al. with our own code: a two-joint arm in the vertical plane
# and one disc. Its configuration space is the plane of the drawing; φ(q) is the distance between
# arm and disc. The seed folds the arm, turns it past the disc and unfolds it.

# %%
import matplotlib.pyplot as plt
import numpy as np

from dmoc import Cost, MotionProblem, load_robot
from dmoc.motion.trajectory import JointPath
from dmoc.refinement import RefineParams, refine
from studies.stud_welding.paper_figures import draw_boxes, draw_clearance, draw_curve, three_stages
from studies.stud_welding.planar_world import PlanarWorld

world = PlanarWorld([1.0, 0.8], [[1.35, 0.75]], [0.25])
seed = JointPath(np.array([[-0.5, 0.3], [-0.5, 2.4], [1.6, 2.4], [1.6, -0.3]]))
problem = MotionProblem(
    load_robot("planar2"),
    seed.q_rad[0],
    seed.q_rad[-1],
    cost=Cost(effort=1e-4, torque_smoothing=0.3),
    num_intervals=20,
)
span = [(-0.9, 2.0), (-0.9, 2.9)]

# %% [markdown]
# ## Figure 1: trajectory and contours of the distance function
#
# The paper's boxes (knots only, stopped at 0.1 %), the half-spaces that are this library's
# default, and the optimum that ignores the disc.

# %%
runs = {}
for name, method, params in (
    ("obstacle-free", "none", None),
    ("boxes", "boxes", RefineParams.paper()),
    ("half-spaces", "halfspaces", None),
):
    records = []
    motion = refine(
        problem, seed, world, method=method, params=params, trace=records.append, fallback=False
    )
    runs[name] = motion, records
    print(
        f"{name:14s} J = {motion.cost:6.3f}  T = {motion.duration_s:5.2f} s  "
        f"certified: {motion.certified}  solves: {len(records)}"
    )

figure, axis = plt.subplots(figsize=(6, 5))
draw_clearance(axis, world.phi, span)
axis.plot(*seed.q_rad.T, "k:", label="seed path")
for name, colour in (("obstacle-free", "C3"), ("boxes", "C0"), ("half-spaces", "C2")):
    q = runs[name][0].trajectory.sample(np.linspace(0, runs[name][0].duration_s, 300)).q_rad
    axis.plot(*q.T, color=colour, label=name)
    axis.plot(*runs[name][0].trajectory.q_rad.T, ".", color=colour, markersize=4)
axis.legend(fontsize=7)
axis.set_title("Trajectories and contours of φ")
figure.savefig("refinement_figure_1.png", dpi=120)

# %% [markdown]
# ## Figure 2: three stages of the boxes
#
# Each box is n‖Δq‖ ≤ φ − d_c in the weighted maximum norm around a knot of the iterate before.
# Boxes are small where the arm is near the disc, and the trajectory creeps towards its optimum.

# %%
figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), sharey=True)
for axis, record, stage in zip(axes, three_stages(runs["boxes"][1]), ("I", "II", "III")):
    draw_clearance(axis, world.phi, span)
    draw_boxes(axis, record)
    draw_curve(axis, record)
    axis.set_title(f"Stage {stage}: iteration {record.outer + 1}, J = {record.cost:.2f}")
figure.savefig("refinement_figure_2.png", dpi=120)

# %% [markdown]
# ## What the drawing shows
#
# The half-spaces reach the optimum in a few iterations, the boxes need several times as many. The
# boxes hold the clearance at the knots only, so between two knots the arm may touch the disc: the
# certificate says whether it does. The obstacle-free optimum is cheaper and collides.

# %%
halfspaces, boxes, free = (runs[name][0] for name in ("half-spaces", "boxes", "obstacle-free"))
assert halfspaces.certified
assert not free.certified
assert not boxes.certified
assert free.cost < halfspaces.cost
assert 0.95 < halfspaces.cost / boxes.cost < 1.05
print(f"half-spaces / boxes: {halfspaces.cost / boxes.cost:.3f}", boxes.certified, boxes.note)
assert 2 * len(runs["half-spaces"][1]) < len(runs["boxes"][1])
