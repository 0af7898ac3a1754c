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
# # Quickstart: plan a stud-welding station
#
# A station is a robot with a tool, obstacles and studs. Planning it gives the order of the welds,
# the robot configuration of every weld, and motions that are optimal in
# J = ∫ c_t + c_e uᵀu + c_v q̇ᵀq̇ dt and certified free of collision between their knots.
#
# With `DMOC_REDUCED=1` the notebook plans three studs instead of eight.

# %%
import os
from pathlib import Path

from planning import demo_station
from sequencing import PlanStop, plan_station, read_run, write_run

station = demo_station("stud_welding_a_8")
if os.environ.get("DMOC_REDUCED"):
    station = station.replace(studs=station.studs[:3])
print(station.name, [stud.id for stud in station.studs])

# %% [markdown]
# Edges (motions between two weld poses) are solved only where they can matter, and kept in a
# store: planning again reads them.

# %%
out = Path("runs/quickstart")
reduced = PlanStop(training_edges=30, coverage_edges=20) if os.environ.get("DMOC_REDUCED") else None
cycle = plan_station(station, seed=0, stop=reduced, store=out / "edges.sqlite")
print("order:", " → ".join(weld.stud for weld in cycle.welds))
print(f"cycle time {cycle.duration_s:.1f} s, {cycle.certified} of {len(cycle.motions)} certified")

# %% [markdown]
# The run folder holds everything: `result.json`, `motions.npz`, a CSV per motion, `tables.md`.
# Table 2 sets the sequence of least travel time against the sequence of least cost, beside the
# figures that were published for another station.

# %%
from IPython.display import Image, Markdown

write_run(cycle, out, timing={})
Markdown((out / "tables.md").read_text())

# %% [markdown]
# Joint positions, velocities and torques over the cycle, as shares of their limits; welds shaded.

# %%
from sequencing.report.curves import write_curves

run = read_run(out)
Image(write_curves(run.timeline, station.robot, out / "curves.png"))

# %% [markdown]
# The moving scene is one page that needs no network: open `scene.html` in a browser. A program
# for a controller says what it keeps of the planned timing, and what not.

# %%
from sequencing.export.exporting import export_run
from sequencing.report.scene import write_scene

scene = write_scene(station, run.timeline, out / "scene.html")
program = export_run(run, "urscript", out / "export")
print(f"{scene.name}: {scene.stat().st_size / 1e6:.1f} MB")
print(f"{program.files[0].name}: at most {program.max_deviation_rad:.1e} rad from the plan")
print(program.statement)

# %% [markdown]
# What must hold for every run:

# %%
assert cycle.certified == len(cycle.motions)
assert all(item.motion.status.ok for item in cycle.motions)
assert cycle.tables.energy_based.total <= cycle.tables.time_based.total
assert scene.stat().st_size < 10e6
print(f"saving {cycle.tables.saving_percent:.1f} % against the sequence of least time")
