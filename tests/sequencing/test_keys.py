"""What a stored edge hangs on: every input of a station, changed one by one."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from dmoc.robot.robot import Robot, Tool, load_robot
from planning.geometry.shapes import Body, Shape, pose_matrix
from planning.station.build import demo_station
from planning.station.station import Station
from sequencing.edges import worker
from sequencing.edges.jobs import EdgeKeys
from sequencing.edges.nodes import HOME, StationNodes

SOURCE = load_robot("irb6640_class").urdf.parent
MESH = '<collision><geometry><mesh filename="bump.stl" scale="1 1 1"/></geometry></collision>'
UNREAD = "not read while an edge is solved"
OTHERS = "decides which edges there are, not what one of them is"


def robot_in(folder: Path, urdf=None, settings=None, mesh=None) -> Robot:
    """The heavy arm with a mesh on link 3, its files changed by `urdf`, `settings` and `mesh`."""
    folder.mkdir(parents=True, exist_ok=True)
    text = (SOURCE / "irb6640_class.urdf").read_text()
    at = text.index("</link>", text.index('<link name="link_3">'))
    text = text[:at] + MESH + text[at:]
    yaml = (SOURCE / "robot.yaml").read_text()
    bump = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
    vertices = np.array(bump.vertices) if mesh is None else mesh(np.array(bump.vertices))
    trimesh.Trimesh(vertices, bump.faces, process=False).export(folder / "bump.stl")
    changed = (text if urdf is None else urdf(text), yaml if settings is None else settings(yaml))
    if urdf is not None or settings is not None:
        assert changed != (text, yaml), "nothing was changed"
    (folder / "arm.urdf").write_text(changed[0])
    (folder / "robot.yaml").write_text(changed[1])
    return load_robot(folder / "arm.urdf")


def swap(old: str, new: str, after: str = "") -> Callable[[str], str]:
    def change(text: str) -> str:
        at = text.index(old, text.index(after))
        return text[:at] + new + text[at + len(old) :]

    return change


def dented(vertices: np.ndarray) -> np.ndarray:
    """One vertex further in: same file name, count and bounding box."""
    inner = np.flatnonzero(np.abs(vertices).max(axis=1) < 0.09)[0]
    vertices[inner] *= 0.8
    return vertices


@cache
def plain() -> Station:
    station = demo_station("stud_welding_a_8")
    hull = Shape("convex", vertices_m=np.vstack([np.eye(3), np.zeros(3)]))
    mesh = Shape("mesh", vertices_m=hull.vertices_m, faces=[[0, 1, 2], [0, 1, 3]])
    wedge = Body("wedge", (hull,), mesh, pose_matrix((5.0, 0.0, 0.0)))
    return station.replace(obstacles=(*station.obstacles, wedge))


def nodes_of(station: Station) -> StationNodes:
    q = np.vstack([np.full(6, 0.1), np.full(6, 0.2), np.full(6, 0.3), station.home_rad])
    return StationNodes(
        q_rad=q,
        line_end_rad=q + 0.01,
        weld_cost=np.zeros(4),
        cluster_of=np.arange(4),
        stud=(*(stud.id for stud in station.studs[:3]), HOME),
        alternative=np.zeros(4, dtype=np.int64),
        home=3,
        studs=tuple(stud.id for stud in station.studs[:3]),
    )


def keys(
    station: Station, nodes=None, method="half-spaces", seed=0, quality="screen", solver="ipopt"
):
    """Keys of the edges between the first two studs, and from the first to home."""
    found = EdgeKeys(station, nodes or nodes_of(station), method, seed, solver)
    return found.key(0, 1, quality), found.key(0, 3, quality)


def shifted(nodes: StationNodes, name: str) -> StationNodes:
    rows = getattr(nodes, name).copy()
    rows[0, 2] += 1e-9
    return replace(nodes, **{name: rows})


def stud(**changes) -> Callable[[Station], Station]:
    def change(station: Station) -> Station:
        return station.replace(studs=(replace(station.studs[0], **changes), *station.studs[1:]))

    return change


def tool(**changes) -> Callable[[Station], Station]:
    def change(station: Station) -> Station:
        old = station.robot.tool
        kept = {name: getattr(old, name) for name in Tool.__dataclass_fields__}
        return station.replace(robot=station.robot.with_tool(Tool(**{**kept, **changes})))

    return change


def body(kind: str, index: int, **changes) -> Callable[[Station], Station]:
    def change(station: Station) -> Station:
        bodies = list(getattr(station, kind))
        bodies[index] = replace(bodies[index], **changes)
        return station.replace(**{kind: tuple(bodies)})

    return change


def limits(**changes) -> Callable[[Station], Station]:
    return lambda station: station.replace(robot=station.robot.with_limits(**changes))


def fields(**changes) -> Callable[[Station], Station]:
    return lambda station: station.replace(**changes)


BOX = Shape("box", (0.3, 0.1, 0.11))
TWIST = pose_matrix((0.1, 0.0, 0.0))
WEDGE = Shape("convex", vertices_m=np.vstack([np.eye(3), np.full(3, -1e-6)]))

# What is changed in the station as it stands in memory, and why the key may stay (None: it may
# not).
IN_MEMORY: dict[str, tuple[Callable[[Station], Station], str | None]] = {
    "cost time": (lambda s: s.replace(cost=replace(s.cost, time=1.1)), None),
    "cost effort": (lambda s: s.replace(cost=replace(s.cost, effort=1.1e-6)), None),
    "cost velocity": (lambda s: s.replace(cost=replace(s.cost, velocity=1.1)), None),
    "clearance": (fields(clearance_m=0.013), None),
    "stray": (fields(stray_m=0.006), None),
    "engine": (fields(engine="fcl"), None),
    "allowed collisions": (fields(allowed_collisions=(("clamp_1", "gun_arm"),)), None),
    "home": (fields(home_rad=np.zeros(6)), None),
    "lower limit": (limits(q_lower_rad=-2.0), None),
    "upper limit": (limits(q_upper_rad=2.0), None),
    "velocity limit": (limits(velocity_limit_rad_s=1.0), None),
    "acceleration limit": (limits(acceleration_limit_rad_s2=3.0), None),
    "torque limit": (limits(torque_limit_nm=9000.0), None),
    "payload": (lambda s: s.replace(robot=s.robot.with_payload(1.0)), None),
    "mass scale": (lambda s: s.replace(robot=s.robot.with_mass_scale(1.01)), None),
    "base": (lambda s: s.replace(robot=s.robot.with_base(pin.SE3(TWIST))), None),
    "tool mass": (tool(mass_kg=91.0), None),
    "tool centre of mass": (tool(com_m=[0.25, 0.0, 0.0]), None),
    "tool inertia": (tool(inertia_kg_m2=np.diag([3.0, 4.0, 2.0])), None),
    "tip position": (tool(tip_position_m=[0.3, 0.0, -0.404]), None),
    "tip orientation": (tool(tip_quaternion_xyzw=[1.0, 0.01, 0.0, 0.0]), None),
    "tool shape": (body("tool_bodies", 0, shapes=(BOX,)), None),
    "tool pose": (body("tool_bodies", 0, pose=TWIST), None),
    "tool name": (body("tool_bodies", 0, name="other"), None),
    "touching body": (body("tool_bodies", 2, touches=False), None),
    "obstacle shape": (body("obstacles", 1, shapes=(BOX,)), None),
    "obstacle pose": (body("obstacles", 1, pose=TWIST), None),
    "obstacle hull": (body("obstacles", -1, shapes=(WEDGE,)), None),
    "obstacle gone": (lambda s: s.replace(obstacles=s.obstacles[:-1]), None),
    "stud position": (stud(position_m=[1.5, -0.4, 0.8001]), None),
    "departure direction": (stud(depart_direction=[0.0, 0.6, 0.8]), None),
    "departure length": (stud(depart_m=0.031), None),
    "stud on": (stud(on="fixture"), None),
    "stud normal": (stud(normal=[0.0, 0.6, 0.8]), None),
    "obstacle mesh": (body("obstacles", -1, mesh=None), UNREAD + ": the second look reads it"),
    "weld time": (stud(weld_time_s=3.0), UNREAD),
    "group": (stud(group="G"), UNREAD),
    "spin free": (stud(spin_free=False), OTHERS),
    "spin steps": (fields(spin_steps=6), OTHERS),
    "precedence": (fields(precedence=(("S01", "S02"),)), OTHERS),
    "another stud": (lambda s: s.replace(studs=(*s.studs[:3], *s.studs[4:])), OTHERS),
    "station name": (fields(name="other"), UNREAD),
    "station file": (fields(source=Path("elsewhere.yaml")), UNREAD),
}

# The same for the files of the robot: (URDF, robot.yaml, mesh).
BOX_ON_LINK = '<collision><geometry><box size="0.08 0.08 0.08"/></geometry></collision></link>'


def in_collision(old: str, new: str) -> Callable[[str], str]:
    """Changes `old` in the collision elements; the visual ones often say the same."""

    def change(text: str) -> str:
        parts = re.split(r"(<collision>.*?</collision>)", text, flags=re.DOTALL)
        return "".join(p.replace(old, new) if p.startswith("<coll") else p for p in parts)

    return change


IN_FILES: dict[str, tuple[dict[str, Callable], str | None]] = {
    "8 cm box on a link": (
        {"urdf": swap("</link>", BOX_ON_LINK, '<link name="link_1">')},
        None,
    ),
    "visual size": ({"urdf": swap('radius="0.34', 'radius="0.35', "link_1")}, UNREAD),
    "link box": ({"urdf": in_collision('size="0.64', 'size="0.65')}, None),
    "link cylinder": ({"urdf": in_collision('radius="0.34', 'radius="0.35')}, None),
    "link cylinder length": ({"urdf": in_collision('length="0.2"', 'length="0.21"')}, None),
    "collision origin": ({"urdf": in_collision('xyz="0.16', 'xyz="0.17')}, None),
    "mesh vertex": ({"mesh": dented}, None),
    "mesh scale": ({"urdf": swap('scale="1 1 1"', 'scale="1 1 1.1"')}, None),
    "link mass": ({"urdf": swap('mass value="330"', 'mass value="331"')}, None),
    "link inertia": ({"urdf": swap('ixx="23.375"', 'ixx="23.4"')}, None),
    "centre of mass": ({"urdf": swap('xyz="0.12 0 -0.12"', 'xyz="0.13 0 -0.12"')}, None),
    "joint axis": ({"urdf": swap('axis xyz="0 1 0"', 'axis xyz="0 1 0.01"')}, None),
    "armature": ({"settings": swap("[250,", "[251,")}, None),
    "acceleration in file": ({"settings": swap("[4.5,", "[4.4,")}, None),
    "flange": ({"urdf": swap('xyz="0', 'xyz="0.01', "flange_fixed")}, None),
    "allowed link pair": ({"settings": swap("  - [link_4, link_6]\n", "")}, None),
    "drive": ({"settings": swap("drive: {class: heavy}", "drive: {class: ur}")}, None),
    "colour": ({"urdf": swap("0.93 0.42 0.10 1", "0.93 0.42 0.11 1")}, UNREAD),
    "provenance": ({"settings": swap("mass: assumed", 'mass: "published: table"')}, UNREAD),
}


def test_at_least_forty_inputs_are_changed() -> None:
    assert len(IN_MEMORY) + len(IN_FILES) >= 40


@pytest.mark.parametrize("name", IN_MEMORY)
def test_a_changed_input_has_a_new_key_or_a_reason(name: str) -> None:
    change, reason = IN_MEMORY[name]
    before, after = keys(plain()), keys(change(plain()))
    if name == "home":  # of the travels only that from home
        assert before[0] == after[0]
        before, after = before[1:], after[1:]
    assert all((a == b) is (reason is not None) for a, b in zip(before, after)), reason


@pytest.mark.parametrize("name", IN_FILES)
def test_a_changed_robot_file_has_a_new_key_or_a_reason(name: str, tmp_path) -> None:
    change, reason = IN_FILES[name]
    old, new = robot_in(tmp_path / "old"), robot_in(tmp_path / "new", **change)
    before, after = (keys(plain().replace(robot=robot)) for robot in (old, new))
    assert all((a == b) is (reason is not None) for a, b in zip(before, after)), reason
    same = plain().replace(robot=old).fingerprint == plain().replace(robot=new).fingerprint
    assert same is (reason is not None), "the station's fingerprint says otherwise"


@pytest.mark.parametrize("name", ["q_rad", "line_end_rad"])
def test_a_pose_is_part_of_the_key(name: str) -> None:
    nodes = nodes_of(plain())
    assert keys(plain(), nodes) != keys(plain(), shifted(nodes, name))


def test_seed_method_and_quality_are_part_of_the_key() -> None:
    found = [keys(plain()), keys(plain(), seed=1), keys(plain(), method="boxes")]
    found += [keys(plain(), quality="final"), keys(plain(), solver="structured")]
    assert len(set(found)) == 5


def test_code_and_libraries_are_part_of_the_key(monkeypatch, tmp_path) -> None:
    before = keys(plain())
    monkeypatch.setattr(worker, "_version", lambda name: "0")
    assert keys(plain()) != before
    monkeypatch.undo()
    assert keys(plain()) == before
    code = worker.code_fingerprint()
    worker.code_fingerprint.cache_clear()
    changed = Path.read_bytes

    def one_digit_more(path: Path) -> bytes:
        return changed(path) + (b"1" if path.name == "distance.py" else b"")

    monkeypatch.setattr(Path, "read_bytes", one_digit_more)
    assert worker.code_fingerprint() != code
    worker.code_fingerprint.cache_clear()


def test_a_key_does_not_depend_on_where_the_files_lie(tmp_path) -> None:
    one, two = robot_in(tmp_path / "a"), robot_in(tmp_path / "deep" / "b")
    assert keys(plain().replace(robot=one)) == keys(plain().replace(robot=two))
