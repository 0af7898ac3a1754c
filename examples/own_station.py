"""A station of one's own from two files: check it, plan it, read the tables."""

from pathlib import Path

from planning import check_station, load_station
from sequencing import PlanStop, plan_station, write_run

Path("station.yaml").write_text("""\
schema_version: 1
name: bracket
robot:
  model: ur10e_class
  q_lower_rad: [-3.14, -3.14, -3.14, -3.14, -3.14, -3.14]  # hoses allow one turn of each joint
  q_upper_rad: [3.14, 3.14, 3.14, 3.14, 3.14, 3.14]
tool:
  shapes: [{name: tip, cylinder_m: [0.01, 0.1], pose: {position_m: [0, 0, 0.05]}, touches: true}]
  tip: {position_m: [0, 0, 0.1]}
obstacles:
  - {name: table, box_m: [1, 1, 0.1], pose: {position_m: [0.7, 0, 0.1]}}
studs: studs.csv
spin_steps: 2
home_rad: [0, -1.5, 1.2, -1, -1.5, 0]
""")
Path("studs.csv").write_text("""\
id,x_m,y_m,z_m,nx,ny,nz,weld_time_s
left,0.6,0.2,0.15,0,0,1,1
right,0.7,-0.2,0.15,0,0,1,1
""")
for stud in check_station("station.yaml")["studs"]:
    print(stud)

# A few edges are enough for two studs; the default budget suits stations of eight and more.
few = PlanStop(training_edges=2, coverage_edges=1, baseline_draws=1)
cycle = plan_station(load_station("station.yaml"), seed=0, stop=few)
print(" → ".join(weld.stud for weld in cycle.welds), f"in {cycle.duration_s:.2f} s")
write_run(cycle, "run", timing={})
print(Path("run/tables.md").read_text(encoding="utf-8")[:200])
