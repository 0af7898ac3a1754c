"""Write the stations of the package: `python -m authoring.stations.generate [FOLDER]`."""

from __future__ import annotations

import csv
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from authoring.stations import underbody
from planning.geometry.convex import write_pieces
from planning.geometry.mesh_file import write_binary_stl

#: Studs of the quick demo: two floor studs a side, tunnel top and side, a sill, an end wall.
DEMO_STUDS = ("S01", "S04", "S07", "S09", "S12", "S14", "S16", "S20")
#: Studs on the sides of tunnel and sills jam along their normal (the gun backs into what lies
#: opposite): they leave upwards, a little off the surface (along n + 3 z).
LIFTED = ("S13", "S14", "S15", "S16", "S17", "S18")
#: The dress pack: joints 4 and 6 turn 200° either way, less than the bare robot.
LIMIT_DEG = ((-170, -65, -180, -200, -120, -200), (170, 85, 70, 200, 120, 200))
CLAMPS = ((1.30, -0.95), (2.50, -0.95), (1.30, 0.98), (2.50, 0.98), (1.90, -0.20))
CLAMP_M = (0.08, 0.08, 0.35)
HOME_RAD = (0.0, -0.35, 0.35, 0.0, 0.6, 0.0)

HERE = Path(__file__).resolve().parents[2] / "planning" / "stations"


@dataclass(frozen=True)
class StationLayout:
    """What differs between the stations: gun offset, where the part lies, the words for it, and
    where the studs come from."""

    folder: str
    gun_offset_m: float
    part_m: tuple[float, float, float]
    remark: str
    studs: str = "own layout"


LAYOUTS = (
    StationLayout("stud_welding_a", 0.30, (0.0, 0.0, 0.0), "Short gun, part at z = 0.80 m."),
    StationLayout("stud_welding_b", 0.90, (0.10, 0.0, -0.25), "Long gun, part shifted."),
    StationLayout(
        "stud_welding_c",
        0.90,
        (0.10, 0.0, -0.25),
        "Station B, studs jittered; picked: without obstacles it gave the published saving.",
        "station B's, jittered; picked for its saving in a prototype without obstacles",
    ),
)


def _gun(offset: float, mass_kg: float) -> str:
    x, y, z = 0.45, 0.25, 0.55
    moments = [
        mass_kg / 12 * (y * y + z * z),
        mass_kg / 12 * (x * x + z * z),
        mass_kg / 12 * (x * x + y * y),
    ]
    ixx, iyy, izz = (f"{moment:.6f}" for moment in moments)
    return f"""\
tool:
  # Flange frame: x along joint 6. The tip's +Z points into the part, here along flange -z.
  shapes:
    - {{name: gun_arm, box_m: [{offset:g}, 0.10, 0.10],
       pose: {{position_m: [{offset / 2:g}, 0, 0.04]}}}}
    - {{name: gun_block, box_m: [0.12, 0.14, 0.36], pose: {{position_m: [{offset:g}, 0, -0.05]}}}}
    - {{name: gun_tip, cylinder_m: [0.045, 0.175], pose: {{position_m: [{offset:g}, 0, -0.3175]}},
       touches: true}}
  mass_kg: {mass_kg:g}
  com_m: [{offset - 0.06:g}, 0, 0]
  inertia_kg_m2: [[{ixx}, 0, 0], [0, {iyy}, 0], [0, 0, {izz}]]
  tip: {{position_m: [{offset:g}, 0, -0.405], quaternion_xyzw: [1, 0, 0, 0]}}
"""


def _obstacles(layout: StationLayout) -> str:
    part = np.array(layout.part_m)
    text = f"""\
obstacles:
  - {{name: underbody, mesh: underbody.stl, unit: m, pieces: underbody_pieces.obj,
     pose: {{position_m: [{part[0]:g}, {part[1]:g}, {part[2]:g}]}}}}
"""
    for number, (x, y) in enumerate(CLAMPS, start=1):
        surface = float(underbody.height_m(np.array(x), np.array(y)))
        centre = part + [x, y, surface + CLAMP_M[2] / 2]
        text += (
            f"  - {{name: clamp_{number}, box_m: [0.08, 0.08, 0.35], "
            f"pose: {{position_m: [{centre[0]:.6g}, {centre[1]:.6g}, {centre[2]:.6g}]}}}}\n"
        )
    height = 0.70 + part[2]
    text += (
        f"  - {{name: fixture, box_m: [1.2, 1.9, {height:.6g}], pose: {{position_m: "
        f"[{1.91 + part[0]:.6g}, 0, {height / 2:.6g}]}}}}\n"
    )
    return text + ("  - {name: ground, box_m: [7, 6, 0.1], pose: {position_m: [1.2, 0, -0.05]}}\n")


def station_text(layout: StationLayout, suffix: str) -> str:
    """The station.yaml of a layout; `suffix` is "", "_8" (eight studs) or "_heavy"."""
    heavy = suffix == "_heavy"
    scales = "\n  mass_scale: 1.6\n  torque_scale: 1.8" if heavy else ""
    home = ", ".join(f"{angle:g}" for angle in HOME_RAD)
    lower, upper = (", ".join(f"{np.deg2rad(v):.6f}" for v in row) for row in LIMIT_DEG)
    return f"""\
# {layout.remark} Written by authoring.stations.generate; sources in provenance.yaml.
schema_version: 1
name: {layout.folder}{suffix}
robot:
  model: irb6640_class{scales}
  # Joints 4 and 6: ±200 degrees, for the hoses of the gun.
  q_lower_rad: [{lower}]
  q_upper_rad: [{upper}]
{_gun(layout.gun_offset_m, 130.0 if heavy else 90.0)}\
{_obstacles(layout)}\
studs: {"studs_8.csv" if suffix == "_8" else "studs.csv"}
spin_steps: 12
departure: {{direction: normal, length_m: 0.03}}
home_rad: [{home}]
clearance_m: 0.012
cost: {{time: 1.0, effort: 1.0e-6, velocity: 1.0}}
"""


PROVENANCE = """\
# Where every number of this station comes from: measured | published: SOURCE | assumed.
robot: "published: kinematics, limits and speeds; masses, torque limits, armature assumed"
robot.q_lower_rad: "assumed: dress pack, joints 4 and 6 within 200 degrees"
robot.mass_scale: "assumed: the heavy variant stands for a 2000 kg class arm"
robot.torque_scale: "assumed: the heavy variant stands for a 2000 kg class arm"
tool.shapes: assumed
tool.mass_kg: assumed
tool.com_m: assumed
tool.inertia_kg_m2: "assumed: homogeneous box 0.45 x 0.25 x 0.55 m"
tool.tip: assumed
obstacles.underbody: "assumed: own car-like shape, no real part"
obstacles.clamps: assumed
obstacles.fixture: assumed
obstacles.ground: assumed
studs.position_m: "assumed: @STUDS@"
studs.normal: "assumed: those of the own car-like shape"
studs.group: "assumed: a label, changes nothing"
studs.weld_time_s: "published: Bjorkenstam et al., section 3 (2 s a weld)"
departure: "assumed: 3 cm along the normal"
studs.depart: "assumed: 3 cm along the normal; upwards where the gun jams"
spin_steps: "assumed: 12"
clearance_m: assumed
home_rad: assumed
cost: "published: Bjorkenstam et al., section 3 (1, 1e-6, 1)"
"""


def _write_studs(source: Path, target: Path, only: tuple[str, ...] | None) -> None:
    """The layout's studs with the departure direction of those that cannot leave along n."""
    with source.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = ["id", "x_m", "y_m", "z_m", "nx", "ny", "nz", "weld_time_s", "group"]
    extra = ["depart_x", "depart_y", "depart_z"]
    lines = [",".join((*names, *extra))]
    for row in rows:
        if only is None or row["id"] in only:
            lift = ["", "", ""]
            if row["id"] in LIFTED:
                normal = np.array([float(row[name]) for name in ("nx", "ny", "nz")])
                upward = normal + [0.0, 0.0, 3.0]
                lift = [f"{v + 0.0:.6f}" for v in upward / np.linalg.norm(upward)]
            cells = [
                row[name].replace("-0.0", "0.0") if row[name] == "-0.0" else row[name]
                for name in names
            ]
            lines.append(",".join((*cells, *lift)))
    target.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def write_stations(folder: Path) -> tuple[Path, ...]:
    """Write all stations below `folder`; returns the files. Same bytes on every run."""
    layouts = HERE / "layouts"
    vertices, faces = underbody.mesh()
    written: list[Path] = []
    for layout in LAYOUTS:
        target = folder / layout.folder
        target.mkdir(parents=True, exist_ok=True)
        write_binary_stl(target / "underbody.stl", vertices, faces)
        write_pieces(target / "underbody_pieces.obj", underbody.prisms())
        tags = PROVENANCE.replace("@STUDS@", layout.studs)
        (target / "provenance.yaml").write_text(tags, encoding="utf-8", newline="\n")
        studs = layouts / f"{layout.folder}.csv"
        _write_studs(studs, target / "studs.csv", None)
        suffixes = ["", "_heavy"]
        if layout.folder == "stud_welding_a":
            suffixes.append("_8")
            _write_studs(studs, target / "studs_8.csv", DEMO_STUDS)
        for suffix in suffixes:
            (target / f"station{suffix}.yaml").write_text(
                station_text(layout, suffix), encoding="utf-8", newline="\n"
            )
        written += sorted(target.iterdir())
    return tuple(written)


if __name__ == "__main__":
    write_stations(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
