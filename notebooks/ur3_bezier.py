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
# # UR3: a particle swarm over Bézier motions, and what its metric measures
#
# Vysocký et al. (Applied Sciences 10, 2020, 8241) let a particle swarm choose the inner control
# points of Bézier joint curves and report 10 to 40 % less energy than movej. Here the same swarm
# works on a model of a UR3e, with velocity, acceleration, torque and joint limits and collisions
# enforced; a gradient descent over the same points and free-form optimal control stand beside it.
#
# **What the paper's metric measures, and what not.** Its Eq. 6 is Σ∫I·V dt with motor currents and
# the 48 V of the bus. A motor takes its current at its own voltage, which the chopper makes a
# fraction of the bus voltage, so I·V is not electrical power. Read as Σ|I|·V it prices torque, that
# of holding still included; read as printed, with signs, it can be negative. On measured UR3e
# moves (`dmoc measured`) Σ|I|·V is 2.7 to 3.8 times the energy that enters the robot on its DC
# side. The physical energy, motor work plus losses, is printed beside it, without and with the
# 36 W that controller and fans take whatever the path.
#
# With `DMOC_REDUCED=1` the swarm gets 2 seeds and 60 iterations instead of 10 and 250.

# %%
import os
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from dmoc import load_robot
from studies.ur3 import figures as draw
from studies.ur3.case import Setting, case_report, judge, saving, solve_case
from studies.ur3.moves import movej, paper_moves
from studies.ur3.reference import free_form
from studies.ur3.sweeps import duration_sweep
from studies.ur3.world import tabletop_world

reduced = os.environ.get("DMOC_REDUCED") == "1"
robot = load_robot("ur3e_class")
setting = Setting(robot, tabletop_world(robot))
if reduced:
    setting = replace(setting, swarm=replace(setting.swarm, iterations=60))
seeds = tuple(range(2 if reduced else 10))
paper_percent = {"A": 23, "B": 37, "C": 10, "D": 16}

# %% [markdown]
# ## Every movement in the paper's metric and in physical joules

# %%
metrics = ("iv_absolute", "energy")
baseline = {move.name: judge(movej(move, robot, 3.0), setting) for move in paper_moves()}
found = {
    (move.name, metric): solve_case(move, metric, setting, seeds)
    for move in paper_moves()
    for metric in metrics
}
report = {key: case_report(case, setting) for key, case in found.items()}

# %% [markdown]
# Table 2 of the paper, in its metric. The paper gives no joint vectors: these movements follow its
# words, so a percentage is not expected to be the same, and random pairs of each class
# (`dmoc study ur3`) show how much it owes to the pose.

# %%
print("move   movej J   swarm J   saving %   gradient %   paper %   feasible")
for name, printed in paper_percent.items():
    row = report[name, "iv_absolute"]
    swarm, gradient = row["swarm"], row["gradient"]
    print(
        f"{name:4} {row['baseline_j']:9.0f} {swarm['median_j']:9.0f} "
        f"{swarm['median_saving_percent']:10.1f} {gradient['saving_percent']:12.1f} "
        f"{printed:9} {sum(swarm['feasible'])}/{len(seeds)} {gradient['feasible']}"
    )

# %% [markdown]
# The same in physical electrical energy, with motions optimised for it, and what the motion that
# is best in the paper's metric does to it.

# %%
print("move   movej J   swarm J   gradient J   with base %   best in |I|V: with base %")
for name in paper_percent:
    row, total = report[name, "energy"], baseline[name]["energy_with_base_j"]
    base = total - baseline[name]["energy_j"]
    other = judge(found[name, "iv_absolute"].best.motion, setting)["energy_with_base_j"]
    print(
        f"{name:4} {row['baseline_j']:9.1f} {row['swarm']['median_j']:9.1f} "
        f"{row['gradient']['value_j']:12.1f} "
        f"{saving(total, row['gradient']['value_j'] + base):12.1f} {saving(total, other):20.1f}"
    )

# %% [markdown]
# ## Convergence of the swarm (Fig. 4), movement A

# %%
figure, axes = plt.subplots(figsize=(6, 3.5))
histories = [result.history for result in found["A", "iv_absolute"].swarm]
draw.draw_convergence(axes, histories, baseline["A"]["iv_absolute_j"])
plt.show()

# %% [markdown]
# ## What streaming costs (Figs. 6 and 7)
#
# Between servoj points the controller interpolates; the deviation of joint 2 grows with the square
# of the update time. The paper measured about 20 mrad, which is mostly the controller's own lag.

# %%
best = found["A", "iv_absolute"].best.motion
figure, axes = plt.subplots(figsize=(6, 3))
draw.draw_sampling(axes, best, (0.008, 0.08), joint=1)
plt.show()
t = np.linspace(0, 3, 3001)
deviation = {
    s: np.abs(draw.streamed(best, s, t) - best.derivative(t, 0)).max() for s in (0.008, 0.08)
}
print({f"{1000 * s:.0f} ms": f"{1000 * d:.3f} mrad" for s, d in deviation.items()})

# %% [markdown]
# ## Currents and joints of movement A (Figs. 7 and 9), and the way of the flange (Fig. 10)

# %%
move = paper_moves()[0]
motions = {
    "movej": movej(move, robot, 3.0),
    "best in |I|·V": best,
    "best in energy": found["A", "energy"].best.motion,
}
figure, axes = plt.subplots(4, 3, figsize=(11, 10), layout="constrained")
draw.draw_currents(axes[:2].ravel(), motions, robot)
draw.draw_joints(axes[2:].ravel(), motions)
plt.show()

# %%
figure = plt.figure(figsize=(5, 5))
draw.draw_tip(figure.add_subplot(projection="3d"), motions, robot)
plt.show()

# %% [markdown]
# ## Free-form optimal control: how near are seven control points?
#
# Same duration and end velocities, warm-started from the best Bézier motion; both curves judged on
# one fine replay with the exact friction model.

# %%
reference = {
    move.name: free_form(move, found[move.name, "energy"].best, setting)[0]
    for move in paper_moves()
}
for name, row in reference.items():
    print(
        f"{name}: {row['status']}, Bézier {row['bezier_j']:.2f} J, free form "
        f"{row['free_form_j']:.2f} J, Bézier above by {row['bezier_above_percent']:.1f} %"
    )

# %% [markdown]
# ## Duration: with base load, fast is cheap

# %%
times = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
rows, best_duration = duration_sweep(paper_moves()[:1], setting, times)
figure, axes = plt.subplots(figsize=(6, 3.5))
axes.plot(times, [row["baseline_j"] for row in rows], "o--", label="movej")
axes.plot(times, [row["gradient_j"] for row in rows], "o-", label="optimised")
axes.plot(times, [row["gradient_with_base_j"] for row in rows], "s-", label="with 36 W base load")
axes.set(xlabel="duration [s]", ylabel="energy of movement A [J]")
axes.legend()
plt.show()
for row in best_duration:
    print(
        f"{row['motion']}: {row['duration_s']} s with base load, "
        f"{row['duration_without_base_s']} s without"
    )

# %% [markdown]
# ## The headline, asserted

# %%
for name in paper_percent:
    row = report[name, "iv_absolute"]
    assert row["gradient"]["feasible"]
    assert all(row["swarm"]["feasible"])
    assert row["gradient_below_swarm_median"]
    assert row["swarm"]["median_saving_percent"] > (5 if reduced else 8)
    assert reference[name]["status"] == "converged"
    assert not reference[name]["bezier_below"]
    total = baseline[name]["energy_with_base_j"]
    physical = judge(found[name, "energy"].best.motion, setting)["energy_with_base_j"]
    assert 0 < saving(total, physical) < 10
assert deviation[0.008] < 2e-4 < deviation[0.08] < 0.03
print("In the paper's metric tens of percent, in physical joules with base load single ones.")
