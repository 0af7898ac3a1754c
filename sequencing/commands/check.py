"""`dmoc check` and `dmoc init`: what a station file holds, and a first one to start from."""

from __future__ import annotations

from pathlib import Path

from dmoc.errors import Fault
from planning.station.build import available_stations, demo_station, load_station
from planning.station.template import init_station
from planning.welds.check import allow_always_near, check_station
from sequencing.commands.console import CommandResult, Console, save_json


def run_check(
    console: Console, station: str, out: Path | None, engines: bool = False
) -> CommandResult:
    """Alternatives per stud, or the reasons why there are none; exit 3 if a stud has none."""
    path = demo_station(station).source if station in available_stations() else station
    data = check_station(path, engines)
    studs = data["studs"]
    console.show(f"{station}: {len(studs)} studs, tool on {data['flange']} of {data['robot']}")
    for row in studs:
        reason = f"  {row['reason']}" if row["reason"] else ""
        depth = 1e3 * row["contact_depth_m"]
        inside = f", shapes overlap by {depth:.2f} mm at the weld" if depth > 0.005 else ""
        console.show(f"  {row['id']:<12} {row['alternatives']:>4} alternatives{inside}{reason}")
    for row in data.get("engines", ()):
        console.show(
            f"  engine {row['engine']:<5} {row['configurations']} configurations: at most "
            f"{1e3 * row['largest_m']:.3f} mm off, {row['above_1_mm']} above 1 mm, "
            f"{row['touching']} touching for one only"
        )
    for doubt in data["warnings"]:
        console.say(f"warning: {Fault(**doubt)}")
    save_json(out, "check.json", data)
    missing = [row["id"] for row in studs if not row["alternatives"]]
    if missing:
        console.say("no alternative for " + ", ".join(missing))
    return CommandResult(data, 3 if missing else 0)


def run_init(
    console: Console,
    urdf: Path,
    part: Path,
    studs: Path,
    out: Path | None,
    unit: str,
    package_path: list[Path],
    total_mass_kg: float | None,
    xacro_arg: list[str],
) -> CommandResult:
    """Write station.yaml with its inputs copied beside it."""
    folder = Path("station") if out is None else out
    arguments = {name: value for name, _, value in (text.partition(":=") for text in xacro_arg)}
    path = init_station(urdf, part, studs, folder, unit, package_path, total_mass_kg, arguments)
    robot = load_station(path).robot
    doubts = robot.description.warnings
    for doubt in doubts:
        console.say(f"warning: {doubt}")
    for first, second, gap in allow_always_near(path):
        console.say(
            f"{first} and {second} are never apart (down to {1e3 * gap:.0f} mm): allowed, as two "
            "parts that cannot really meet; look at them, and strike the line if they can"
        )
    console.show(f"wrote {path}, the tool on {robot.flange}; next: dmoc check {path}")
    warnings = [doubt.to_dict() for doubt in doubts]
    return CommandResult({"station": str(path), "flange": robot.flange, "warnings": warnings})
