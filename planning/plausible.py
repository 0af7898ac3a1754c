"""What is legal in a station but hardly meant: warnings of `dmoc check`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dmoc.arrays import Array
from dmoc.errors import Fault
from planning.nearest import body_distance_m
from planning.shapes import Body
from planning.station import Station

__all__ = ["station_warnings"]

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
    return tuple(Fault(f.code, file, f.field, f.value, f.legal, f.fix) for f in found)


def _tool(station: Station) -> Iterator[Fault]:
    tool, bodies = station.robot.tool, station.tool_bodies
    moment = float(np.abs(tool.inertia_kg_m2).max())
    if not bodies:
        yield Fault(
            "tool-bare", field="tool.shapes", value="no solid",
            legal="a shape or a mesh for what hangs on the flange",
            fix="give the tool's shapes: what has none is never seen to collide",
        )  # fmt: skip
    if tool.mass_kg == 0 and moment > 0:
        yield Fault(
            "tool-massless", field="tool.mass_kg", value="0 with an inertia",
            legal="> 0 where inertia_kg_m2 is given", fix="give the mass: the inertia is ignored",
        )  # fmt: skip
    elif tool.mass_kg == 0 and bodies:
        yield Fault(
            "tool-massless", field="tool.mass_kg", value="0",
            legal="> 0 for a tool with a solid",
            fix="give mass_kg and com_m: torques and energy are now those of the bare arm",
        )  # fmt: skip
    elif moment > GYRATION_M**2 * tool.mass_kg:
        yield Fault(
            "tool-inertia", field="tool.inertia_kg_m2", value=f"{moment:g} kg m²",
            legal=f"<= {GYRATION_M**2 * tool.mass_kg:g} kg m² for {tool.mass_kg:g} kg within "
            f"{GYRATION_M:g} m", fix="give it about the centre of mass, in kg m²",
        )  # fmt: skip
    if bodies and any(stud.on for stud in station.studs):
        if not any(body.touches for body in bodies):
            yield Fault(
                "tool-touches", field="tool.shapes", value="no shape with touches: true",
                legal="the shape that meets the part at a weld", fix="mark it with touches: true",
            )  # fmt: skip
        gap = min(body_distance_m(body, np.array(tool.tip_position_m)) for body in bodies)
        if gap > TIP_GAP_M:
            yield Fault(
                "tool-tip", field="tool.tip", value=f"{gap:.3f} m from the nearest tool shape",
                legal=f"<= {TIP_GAP_M:g} m", fix="check tip.position_m (flange frame, metres)",
            )  # fmt: skip


def _studs(station: Station) -> Iterator[Fault]:
    obstacles = {body.name: body for body in station.obstacles}
    for stud in station.studs:
        if not stud.on and obstacles:
            gap = min(body_distance_m(body, stud.position_m) for body in obstacles.values())
            yield Fault(
                "stud-floating", field=f"studs {stud.id}",
                value=f"{gap:.3f} m from the nearest obstacle", legal="on an obstacle",
                fix="check the frame of the coordinates (world, metres)",
            )  # fmt: skip
        elif stud.on and _is_inside(obstacles[stud.on], stud.position_m + OUTWARDS_M * stud.normal):
            yield Fault(
                "stud-normal", field=f"studs {stud.id}",
                value=f"the normal {np.round(stud.normal, 3).tolist()} points into {stud.on}",
                legal="a normal that points out of the part", fix="turn nx, ny, nz around",
            )  # fmt: skip
    at = np.array([stud.position_m for stud in station.studs])
    for i, stud in enumerate(station.studs):
        same = np.flatnonzero(np.linalg.norm(at[:i] - at[i], axis=1) < SAME_PLACE_M)
        if len(same):
            yield Fault(
                "stud-twice", field=f"studs {stud.id}",
                value=f"the place of {station.studs[same[0]].id}", legal="one stud in one place",
                fix="remove one of the two",
            )  # fmt: skip


def _is_inside(body: Body, point: Array) -> bool:
    """Whether a world point lies in one of the body's pieces."""
    return body_distance_m(replace(body, mesh=None), point) <= 0.0
