"""scene.html: the station in 3-D with the robot moving through the cycle, offline, in one file."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.robot.robot import Robot
from planning.geometry.shapes import Body
from planning.station.station import Station
from sequencing.report.geometry import Triangles, body_triangles, robot_triangles
from sequencing.report.scene_frames import frame_times, joint_frames, tip_path
from sequencing.runs.archive import write_atomic
from sequencing.runs.clock import CycleTimeline

_TOOL = (70, 74, 82)
_PART = (168, 178, 190)
_CLAMP = (205, 160, 60)
_GROUND = (236, 238, 240)
_DONE = (60, 165, 90)
_UNUSED = (130, 130, 130)
_FIELD_OF_VIEW_RAD = 0.7


def write_scene(station: Station, line: CycleTimeline, path: Path, title: str = "") -> Path:
    """Write `scene_html` to `path` in one step and return the path."""
    write_atomic(path, scene_html(station, line, title))
    return path


FRAMES_PER_S = 25.0
MOST_FRAMES = 4000


def scene_html(station: Station, line: CycleTimeline, title: str = "") -> str:
    """A page that plays the cycle in real time and in true size; it needs no network.

    Robot links from the URDF, tool bodies on the flange, obstacles with their own meshes, studs
    coloured in the order of welding with their normals, and the path of the tool tip. The picture
    rate is lowered where a cycle would need more than `MOST_FRAMES`.
    """
    title = title or station.name
    times = frame_times(line.duration_s, FRAMES_PER_S, MOST_FRAMES)
    # viser announces its server on standard output, which belongs to the command's answer.
    with contextlib.redirect_stdout(io.StringIO()), _server() as server:
        scene = server.scene
        scene.set_up_direction("+z")
        heads = _draw_station(scene, station, line)
        joints = _draw_robot(scene, station.robot, station.tool_bodies)
        low, high = _extent(station)
        _set_camera(server, low, high)
        # On the floor between camera and station, where nothing hides it.
        place = (float(low[0] + high[0]) / 2, float(low[1]) - 0.25, 0.0)
        caption = scene.add_label("/caption", title, position=place, anchor="center-center")
        recorder = server.get_scene_serializer()
        _record(recorder, joints, caption, heads, station.robot, line, times)
        page = str(recorder.as_html())
    return page.replace("<title>Viser</title>", f"<title>{escape(title)}</title>", 1)


@contextlib.contextmanager
def _server() -> Iterator[Any]:
    import viser

    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        yield server
    finally:
        server.stop()


def _draw_triangles(scene: Any, path: str, item: Triangles) -> None:
    scene.add_mesh_simple(
        path,
        item.vertices_m.astype(np.float32),
        item.faces.astype(np.uint32),
        color=item.colour,
        flat_shading=True,
        side="double",
    )


def _draw_station(scene: Any, station: Station, line: CycleTimeline) -> dict[str, Any]:
    """Everything that stands still; returns the heads of the studs by name."""
    scene.add_grid(
        "/floor",
        width=8.0,
        height=8.0,
        cell_size=0.25,
        section_size=1.0,
        plane_color=_GROUND,
        plane_opacity=0.4,
        position=(0.0, 0.0, 0.002),
    )
    for body in station.obstacles:
        colour = _PART if body.mesh is not None else _CLAMP
        for item in body_triangles(body, _GROUND if _is_ground(body) else colour):
            _draw_triangles(scene, f"/station/{item.name}", item)
    colours, number, heads = order_colours(len(line.welds)), line.weld_number(), {}
    for stud in station.studs:
        place = number.get(stud.id)
        colour = _UNUSED if place is None else colours[place - 1]
        heads[stud.id] = scene.add_icosphere(
            f"/studs/{stud.id}/head",
            radius=0.022,
            color=colour,
            position=stud.position_m,
            subdivisions=2,
        )
        ends = np.array([[stud.position_m, stud.position_m + 0.12 * stud.normal]])
        scene.add_line_segments(f"/studs/{stud.id}/normal", ends, colour, thickness=0.009)
        text = stud.id if place is None else f"{place} · {stud.id}"
        scene.add_label(
            f"/studs/{stud.id}/label",
            text,
            font_screen_scale=0.7,
            anchor="bottom-center",
            position=stud.position_m + 0.15 * stud.normal,
        )
    segments, which = tip_path(line, station.robot)
    if len(segments):
        tints = np.array(order_colours(int(which.max()) + 1), dtype=np.uint8)[which]
        scene.add_line_segments(
            "/tip_path", segments, np.repeat(tints[:, None], 2, axis=1), thickness=0.006
        )
    return heads


def order_colours(count: int) -> list[tuple[int, int, int]]:
    """Colours from first (dark blue) to last (yellow), 0–255."""
    from matplotlib import colormaps

    shades = colormaps["plasma"](np.linspace(0.0, 0.92, max(count, 1)))[:, :3]
    return [(int(r), int(g), int(b)) for r, g, b in np.round(255 * shades)]


def _draw_robot(scene: Any, robot: Robot, tool: Sequence[Body]) -> list[Any]:
    """Frames of the joints (each a child of its parent joint's) with the links' shapes on them."""
    shapes = robot_triangles(robot)
    for item in shapes[0]:
        _draw_triangles(scene, f"/robot/base/{item.name}", item)
    paths, handles = ["/robot"], []
    for joint in range(1, robot.model.njoints):
        path = f"{paths[robot.model.parents[joint]]}/j{joint}"
        paths.append(path)
        handles.append(scene.add_frame(path, show_axes=False))
        for item in shapes[joint]:
            _draw_triangles(scene, f"{path}/{item.name}", item)
    flange = robot.model.frames[robot.flange_id]
    placement = pin.SE3ToXYZQUAT(flange.placement)
    mount = f"{paths[flange.parentJoint]}/tool"
    scene.add_frame(mount, show_axes=False, position=placement[:3], wxyz=placement[[6, 3, 4, 5]])
    for body in tool:
        for item in body_triangles(body, _TOOL):
            _draw_triangles(scene, f"{mount}/{item.name}", item)
    return handles


def _is_ground(body: Body) -> bool:
    """A body that ends at floor level is floor: pale, and no reason to step back."""
    return all(item.vertices_m[:, 2].max() < 0.05 for item in body_triangles(body))


def _extent(station: Station) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) [m] of robot base, a raised arm, studs and obstacles."""
    base = np.array(station.robot.base.translation)
    points = [np.stack([base, base + [0.0, 0.0, 2.2], *(s.position_m for s in station.studs)])]
    for body in station.obstacles:
        if not _is_ground(body):
            points += [item.vertices_m for item in body_triangles(body)]
    everything = np.concatenate(points)
    return everything.min(axis=0), everything.max(axis=0)


def _set_camera(server: Any, low: Array, high: Array) -> None:
    """Look from the robot's front and side at the middle of what there is."""
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    direction = np.array([0.45, -1.0, 0.5])
    distance = 0.42 * size / np.sin(_FIELD_OF_VIEW_RAD / 2)
    server.initial_camera.fov = _FIELD_OF_VIEW_RAD
    server.initial_camera.look_at = tuple(middle)
    server.initial_camera.position = tuple(
        middle + distance * direction / np.linalg.norm(direction)
    )


def _record(
    recorder: Any,
    joints: list[Any],
    caption: Any,
    heads: dict[str, Any],
    robot: Robot,
    line: CycleTimeline,
    times: Array,
) -> None:
    """Write every picture of the cycle: joint frames that changed, caption, welded studs."""
    frames = joint_frames(robot, line.at(times).q_rad)
    shown = -1
    for k, time in enumerate(times):
        for joint, handle in enumerate(joints):
            if k == 0 or not np.array_equal(frames[k, joint], frames[k - 1, joint]):
                handle.position = frames[k, joint, :3]
                handle.wxyz = frames[k, joint, 3:]
        number = line.segment_at(float(time))
        if number != shown:
            segment = line.segments[number]
            what = "weld" if segment.kind == "weld" else "travel"
            caption.text = f"{time:.1f} s  {what} {segment.label}"
            if segment.kind == "weld" and segment.label in heads:
                heads[segment.label].color = _DONE
            shown = number
        if k + 1 < len(times):
            recorder.insert_sleep(float(times[k + 1] - time))
    recorder.insert_sleep(1.0)
