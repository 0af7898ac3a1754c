"""The identity of a station: a hash of all that decides its motions."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from planning.station import Station

__all__ = ["station_fingerprint"]


def station_fingerprint(station: Station) -> str:
    """sha256 of everything in a station that changes a motion or an alternative."""
    digest = hashlib.sha256()

    def add(*values: Any) -> None:
        for value in values:
            if isinstance(value, np.ndarray):
                digest.update(str(value.shape).encode())
                digest.update(np.ascontiguousarray(value).tobytes())
            else:
                digest.update(repr(value).encode())
            digest.update(b"|")

    add(station.robot.fingerprint, station.robot.flange)
    geometry = station.robot.geometry()
    for item in geometry.geometryObjects:
        add(item.parentFrame, item.placement.homogeneous, item.meshPath.rsplit("/", 1)[-1],
            np.array(item.meshScale), type(item.geometry).__name__)  # fmt: skip
        item.geometry.computeLocalAABB()
        add(np.array(item.geometry.aabb_local.min_), np.array(item.geometry.aabb_local.max_))
    for body in (*station.tool_bodies, *station.obstacles):
        add(body.name, body.pose, body.touches)
        for shape in (*body.shapes, *((body.mesh,) if body.mesh else ())):
            add(shape.kind, shape.size_m, shape.pose, shape.vertices_m, shape.faces)
    for stud in station.studs:
        add(stud.id, stud.position_m, stud.normal, stud.weld_time_s, stud.depart_direction,
            stud.depart_m, stud.spin_free, stud.on)  # fmt: skip
    cost = station.cost
    add(station.spin_steps, station.home_rad, station.clearance_m, station.stray_m, cost.time,
        cost.effort, cost.velocity, station.precedence, station.allowed_collisions,
        station.engine)  # fmt: skip
    return digest.hexdigest()
