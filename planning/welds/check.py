"""`dmoc check`: what a station file holds, and what each stud can be welded with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import Fault, InputError
from planning.collision.departure_line import DepartureLine
from planning.collision.scene import ENGINES
from planning.collision.world import CollisionWorld
from planning.geometry.nearest import body_distance_m
from planning.geometry.shapes import Body
from planning.station.build import load_station
from planning.station.station import Station
from planning.welds.alternatives_search import alternatives, demanded_clearance_m
from planning.welds.poses import MOST_POSES, StudAlternatives, weld_line

#: Engines that differ by more disagree [m].
DISAGREEMENT_M = 1e-3
CAP_M = 0.3
#: Weld poses that are compared, spread over all alternatives; and configurations drawn at random.
MOST_WELDS, RANDOM = 60, 60


def second_opinions(station: Station, studs: Sequence[StudAlternatives]) -> list[dict[str, Any]]:
    """How far every engine is from that of the station, at weld poses and random configurations.

    One entry per other engine: `engine`, `configurations`, `largest_m` (of the differences where
    both see a gap), `above_1_mm` and `touching` (one sees contact deeper than 1 mm, the other
    none): how many configurations; `worst`: pair and joint angles of the largest difference.
    Depths are not compared: an overlap has several legal ones.
    """
    rng = np.random.default_rng(0)
    robot = station.robot
    drawn = rng.uniform(robot.q_lower_rad, robot.q_upper_rad, (RANDOM, robot.num_joints))
    asked: list[tuple[Array, tuple[DepartureLine, ...]]] = [(q, ()) for q in drawn]
    welds = [
        (item.q_rad, weld_line(station, found.stud), found.stud.on)
        for found in studs
        for item in found.alternatives
    ]
    for q, line, on in welds[:: max(1, len(welds) // MOST_WELDS)]:
        asked.append((q, (line,) if on else ()))
    own = CollisionWorld(station)
    answers = [own.distance(q, CAP_M, lines) for q, lines in asked]
    return [
        _opinion(CollisionWorld(station, engine=name), asked, answers)
        for name in ENGINES
        if name != own.engine
    ]


def _opinion(
    other: CollisionWorld,
    asked: Sequence[tuple[Array, tuple[DepartureLine, ...]]],
    answers: Sequence[tuple[float, tuple[str, str] | None]],
) -> dict[str, Any]:
    largest, worst, above, touching = 0.0, None, 0, 0
    for (q, lines), (ours, pair) in zip(asked, answers, strict=True):
        theirs, their_pair = other.distance(q, CAP_M, lines)
        if min(ours, theirs) <= 0.0:
            touching += bool(abs(ours - theirs) > DISAGREEMENT_M and max(ours, theirs) > 0.0)
            continue
        gap = abs(ours - theirs)
        above += gap > DISAGREEMENT_M
        if gap > largest:
            largest = gap
            named = pair or their_pair or ("", "")
            worst = {"pair": list(named), "q_rad": [float(x) for x in q]}
    return {
        "engine": other.engine,
        "configurations": len(asked),
        "largest_m": float(largest),
        "above_1_mm": int(above),
        "touching": touching,
        "worst": worst,
    }


#: A tip farther than this from every solid of the tool points into thin air [m].
TIP_GAP_M = 0.1
#: A tool whose radius of gyration is larger has its inertia in another unit [m].
GYRATION_M = 3.0
#: Studs nearer than this to each other are one stud listed twice [m].
SAME_PLACE_M = 1e-4
#: This far along a normal that points outwards one is out of the part [m].
OUTWARDS_M = 0.01


def station_warnings(station: Station) -> tuple[Fault, ...]:
    """Doubts about a station that is otherwise legal, as faults with code, value and fix."""
    file = str(station.source)
    found = (*_tool(station), *_studs(station))
    own = station.robot.description.warnings
    return (*own, *(Fault(f.code, file, f.field, f.value, f.legal, f.fix) for f in found))


def _tool(station: Station) -> Iterator[Fault]:
    tool, bodies = station.robot.tool, station.tool_bodies
    moment = float(np.abs(tool.inertia_kg_m2).max())
    if not bodies:
        yield Fault(
            "tool-bare",
            field="tool.shapes",
            value="no solid",
            legal="a shape or a mesh for what hangs on the flange",
            fix="give the tool's shapes: what has none is never seen to collide",
        )
    if tool.mass_kg == 0 and moment > 0:
        yield Fault(
            "tool-massless",
            field="tool.mass_kg",
            value="0 with an inertia",
            legal="> 0 where inertia_kg_m2 is given",
            fix="give the mass: the inertia is ignored",
        )
    elif tool.mass_kg == 0 and bodies:
        yield Fault(
            "tool-massless",
            field="tool.mass_kg",
            value="0",
            legal="> 0 for a tool with a solid",
            fix="give mass_kg and com_m: torques and energy are now those of the bare arm",
        )
    elif moment > GYRATION_M**2 * tool.mass_kg:
        yield Fault(
            "tool-inertia",
            field="tool.inertia_kg_m2",
            value=f"{moment:g} kg m²",
            legal=f"<= {GYRATION_M**2 * tool.mass_kg:g} kg m² for {tool.mass_kg:g} kg within "
            f"{GYRATION_M:g} m",
            fix="give it about the centre of mass, in kg m²",
        )
    if bodies and any(stud.on for stud in station.studs):
        if not any(body.touches for body in bodies):
            yield Fault(
                "tool-touches",
                field="tool.shapes",
                value="no shape with touches: true",
                legal="the shape that meets the part at a weld",
                fix="mark it with touches: true",
            )
        gap = min(body_distance_m(body, np.array(tool.tip_position_m)) for body in bodies)
        if gap > TIP_GAP_M:
            yield Fault(
                "tool-tip",
                field="tool.tip",
                value=f"{gap:.3f} m from the nearest tool shape",
                legal=f"<= {TIP_GAP_M:g} m",
                fix="check tip.position_m (flange frame, metres)",
            )


def _studs(station: Station) -> Iterator[Fault]:
    obstacles = {body.name: body for body in station.obstacles}
    for stud in station.studs:
        if not stud.on and obstacles:
            gap = min(body_distance_m(body, stud.position_m) for body in obstacles.values())
            yield Fault(
                "stud-floating",
                field=f"studs {stud.id}",
                value=f"{gap:.3f} m from the nearest obstacle",
                legal="on an obstacle",
                fix="check the frame of the coordinates (world, metres)",
            )
        elif stud.on and _is_inside(obstacles[stud.on], stud.position_m + OUTWARDS_M * stud.normal):
            yield Fault(
                "stud-normal",
                field=f"studs {stud.id}",
                value=f"the normal {np.round(stud.normal, 3).tolist()} points into {stud.on}",
                legal="a normal that points out of the part",
                fix="turn nx, ny, nz around",
            )
    at = np.array([stud.position_m for stud in station.studs])
    for i, stud in enumerate(station.studs):
        same = np.flatnonzero(np.linalg.norm(at[:i] - at[i], axis=1) < SAME_PLACE_M)
        if len(same):
            yield Fault(
                "stud-twice",
                field=f"studs {stud.id}",
                value=f"the place of {station.studs[same[0]].id}",
                legal="one stud in one place",
                fix="remove one of the two",
            )


def _is_inside(body: Body, point: Array) -> bool:
    """Whether a world point lies in one of the body's pieces."""
    return body_distance_m(replace(body, mesh=None), point) <= 0.0


def check_station(path: str | Path, engines: bool = False) -> dict[str, Any]:
    """The object of `dmoc check --json`.

    `studs`: per stud `id`, `alternatives` (their number), `reason` (empty, or what took the
    candidates away, most frequent first), `weld_cost` [least, most] or null, `contact_depth_m`
    (how deep the shapes of tool and part overlap at the deepest weld pose); besides `name`,
    `robot`, `flange`, `configurations`, `clearance_m`, an empty `errors`, and `warnings`: what is
    legal but hardly meant, each like an error (code, file, field, value, legal, fix). With
    `engines` also `engines`: how far the other collision engines are from the station's
    (`planning.welds.check`); more than 1 mm is a warning.

    Errors: `InputError` with every fault of the file, or the home pose's collision.
    """
    station = load_station(path)
    world = CollisionWorld(station)
    check_home(station, world)
    rows = []
    studs = alternatives(station, world)
    for found in studs:
        counted = sorted(found.reasons.items(), key=lambda item: (-item[1], item[0]))
        costs = [item.weld_cost for item in found.alternatives]
        rows.append(
            {
                "id": found.stud.id,
                "alternatives": len(found.alternatives),
                "reason": "" if costs else ", ".join(f"{text} ({n})" for text, n in counted),
                "weld_cost": [min(costs), max(costs)] if costs else None,
                "contact_depth_m": max(
                    (contact_depth_m(world, item.q_rad) for item in found.alternatives), default=0.0
                ),
            }
        )
    count = sum(len(found.alternatives) for found in studs)
    doubts = [*station_warnings(station), *_always(station, world), *_many(station, count)]
    opinions = second_opinions(station, studs) if engines else []
    doubts += [
        _disagreement(station, opinion)
        for opinion in opinions
        if opinion["above_1_mm"] or opinion["touching"]
    ]
    return {
        "name": station.name,
        "robot": station.robot.name,
        "flange": station.robot.flange,
        "clearance_m": station.clearance_m,
        "configurations": count,
        "studs": rows,
        "errors": [],
        "warnings": [fault.to_dict() for fault in doubts],
        **({"engines": opinions} if engines else {}),
    }


def contact_depth_m(world: CollisionWorld, q_rad: Array) -> float:
    """How deep the collision shapes of tool and part overlap at a weld pose [m]; 0 without contact.

    Shapes are convex pieces and stay outside the mesh, so the bodies themselves overlap less.
    """
    return max(0.0, -world.distance(q_rad, 0.0)[0])


def _disagreement(station: Station, opinion: dict[str, Any]) -> Fault:
    return Fault(
        "engines-disagree",
        file=str(station.source),
        field="engine",
        value=f"{opinion['engine']} differs by up to {1e3 * opinion['largest_m']:.2f} mm; "
        f"{opinion['above_1_mm']} of {opinion['configurations']} configurations above 1 mm, "
        f"{opinion['touching']} touching for one only",
        legal="<= 1 mm",
        fix="look at the pair under engines.worst: a thin or badly formed piece",
    )


def always_near(station: Station, world: CollisionWorld) -> list[tuple[str, str, float]]:
    """Pairs of the robot's own bodies that violate the clearance in all of many random poses.

    With the least distance that was seen [m]: below 0 their shapes overlap. No pose keeps such a
    pair apart, so nothing can be planned unless it is allowed.
    """
    robot, gap_m, rng = station.robot, demanded_clearance_m(station), np.random.default_rng(0)
    standing = {body.name for body in station.obstacles}
    least: dict[tuple[str, str], float] = {}
    for number in range(RANDOM):
        q = rng.uniform(robot.q_lower_rad, robot.q_upper_rad)
        near = {pair: gap for pair, gap in world.distances(q, gap_m) if not standing & {*pair}}
        kept = near.keys() if number == 0 else near.keys() & least.keys()
        least = {pair: min(near[pair], least.get(pair, np.inf)) for pair in kept}
        if not least:
            break
    return [(min(pair), max(pair), gap) for pair, gap in sorted(least.items())]


def allow_always_near(path: Path) -> list[tuple[str, str, float]]:
    """Write the pairs that are always near into a new station.yaml; returns them."""
    station = load_station(path)
    pairs = always_near(station, CollisionWorld(station))
    rows = [
        f"  - [{first}, {second}]  # never {1e3 * station.clearance_m:g} mm apart\n"
        for first, second, _ in pairs
    ]
    if rows:
        text = path.read_text(encoding="utf-8")
        text = text.replace("allowed_collisions: []\n", "allowed_collisions:\n" + "".join(rows))
        path.write_text(text, encoding="utf-8", newline="\n")
    return pairs


def _always(station: Station, world: CollisionWorld) -> Iterator[Fault]:
    for first, second, gap in always_near(station, world):
        yield Fault(
            "pair-always",
            str(station.source),
            "allowed_collisions",
            f"{first} and {second} are always nearer than {station.clearance_m:g} m "
            f"(down to {1e3 * gap:.0f} mm)",
            "pairs that some pose keeps apart",
            f"write - [{first}, {second}] if they cannot really meet",
        )


def _many(station: Station, poses: int) -> Iterator[Fault]:
    if poses > MOST_POSES:
        robot = station.robot
        room = robot.q_upper_rad - robot.q_lower_rad >= 2 * np.pi
        joints = ", ".join(str(j + 1) for j in np.flatnonzero(room)) or "none"
        yield Fault(
            "poses-many",
            str(station.source),
            "q_lower_rad, q_upper_rad, spin_steps",
            f"{poses} poses; joints with room for full turns: {joints}",
            f"<= {MOST_POSES}: of more, plan and place choose and say what that may cost",
            "give those joints narrower limits in the robot's block, or fewer spin_steps",
        )


def check_home(station: Station, world: CollisionWorld) -> None:
    """Raise `InputError` if the home pose touches something or cannot be held."""
    if station.home_rad is None:
        return
    robot = station.robot
    torque = np.abs(robot.gravity_torque_nm(station.home_rad))
    weak = [
        Fault(
            "home-torque",
            file=str(station.source),
            field="home_rad",
            value=f"{torque[j]:.4g} N·m to stand still on joint {j + 1}",
            legal=f"<= {robot.torque_limit_nm[j]:.4g} N·m",
            fix="check payload_kg, tool.mass_kg and tool.com_m, or choose another home pose",
        )
        for j in np.flatnonzero(torque > robot.torque_limit_nm)
    ]
    if weak:
        raise InputError(weak)
    pair = world.collide(station.home_rad, station.clearance_m)
    if pair is not None:
        raise InputError.of(
            "home-collision",
            file=str(station.source),
            field="home_rad",
            value=f"{pair[0]} and {pair[1]} at {np.round(station.home_rad, 4).tolist()}",
            legal=f"a pose that keeps {station.clearance_m:g} m from everything",
            fix="choose another home pose, or null",
        )
