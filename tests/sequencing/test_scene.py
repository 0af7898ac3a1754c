"""scene.html: complete, small, offline; in a browser (where there is one) it shows and moves."""

from __future__ import annotations

import base64
import io
import re
import time

import msgspec
import numpy as np
import pytest
import zstandard
from chromium_shots import CHROMIUM, opened
from sample_cycle import sample_cycle

from planning.geometry.shapes import Body, Shape, pose_matrix
from sequencing.report.geometry import body_triangles, robot_triangles
from sequencing.report.scene import order_colours, write_scene
from sequencing.report.scene_frames import frame_times, joint_frames, tip_path
from sequencing.runs.clock import timeline

SEEK = """(() => {
  const field = document.querySelector('input');
  const put = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
  put.call(field, '%s');
  field.dispatchEvent(new Event('input', {bubbles: true}));
  return true;
})()"""


@pytest.fixture(scope="module")
def cycle():
    return sample_cycle()


@pytest.fixture(scope="module")
def line(cycle):
    return timeline(cycle.welds, cycle.motions)


@pytest.fixture(scope="module")
def page(cycle, line, tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.html"
    return write_scene(cycle.station, line, path, "a <cycle>")


def recording(page):
    """Duration and messages (time, message) of the recording that the page carries."""
    text = page.read_text(encoding="utf-8")
    data = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]+)"', text).group(1))
    inner = zstandard.ZstdDecompressor().decompressobj().decompress(data[8:])
    length = int.from_bytes(inner[:8], "little")
    content = msgspec.msgpack.decode(inner[8 : 8 + length], strict=False)
    return content["durationSeconds"], content["messages"]


def test_the_page_is_small_and_needs_no_network(page):
    assert page.stat().st_size < 10_000_000
    text = page.read_text(encoding="utf-8")
    assert "<title>a &lt;cycle&gt;</title>" in text
    shell = re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert not re.findall(r'(?:src|href)="https?://', shell)


def test_the_recording_shows_the_cycle_in_real_time(page, line, cycle):
    duration, messages = recording(page)
    assert duration == pytest.approx(line.duration_s + 1.0, abs=0.01)
    names = {message.get("name") for _, message in messages}
    for stud in cycle.station.studs:
        assert f"/studs/{stud.id}/head" in names
    assert any(name and name.startswith("/station/table") for name in names)
    assert any(name and name.endswith("/tool/gun/0") for name in names)
    turning = [
        (t, tuple(message["wxyz"]))
        for t, message in messages
        if message.get("name", "").endswith("/j2") and message["type"] == "SetOrientationMessage"
    ]
    moving = [t for (t, pose), (_, old) in zip(turning[1:], turning) if pose != old]
    assert len(moving) > 100
    assert max(moving) > 0.9 * line.duration_s
    weld = next(s for s in line.segments if s.kind == "weld")
    assert not [t for t in moving if weld.start_s + 0.1 < t < weld.end_s - 0.1]


def test_nothing_is_printed(cycle, line, tmp_path, capfd):
    write_scene(cycle.station, line, tmp_path / "scene.html")
    assert capfd.readouterr().out == ""


def test_frames_put_the_tip_where_the_robot_says(cycle, line):
    robot = cycle.station.robot
    q = line.at(np.array([3.3])).q_rad
    pose = np.eye(4)
    for x, y, z, qw, qx, qy, qz in joint_frames(robot, q)[0]:
        pose = pose @ pose_matrix((x, y, z), (qx, qy, qz, qw))
    flange = robot.model.frames[robot.flange_id].placement.homogeneous
    tip = pose @ flange @ robot.tool.tip.homogeneous
    np.testing.assert_allclose(tip, robot.tip_pose(q[0]).homogeneous, atol=1e-4)


def test_the_tips_path_visits_every_stud(cycle, line):
    segments, which = tip_path(line, cycle.station.robot)
    assert set(which) == set(range(len(cycle.motions)))
    for stud in cycle.station.studs:
        gaps = np.linalg.norm(segments[:, 1] - stud.position_m, axis=1)
        assert gaps.min() < 1e-6


def test_triangles_have_the_sizes_of_the_shapes():
    shapes = (
        Shape("box", (0.2, 0.4, 0.6)),
        Shape("cylinder", (0.1, 0.8)),
        Shape("sphere", (0.3,)),
        Shape("convex", vertices_m=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])),
    )
    body = Body("all", shapes, pose=pose_matrix((1.0, 2.0, 3.0)))
    spans = [np.ptp(item.vertices_m, axis=0) for item in body_triangles(body)]
    np.testing.assert_allclose(spans[0], [0.2, 0.4, 0.6])
    np.testing.assert_allclose(spans[1], [0.2, 0.2, 0.8], atol=1e-3)
    np.testing.assert_allclose(spans[2], 0.6, atol=1e-6)
    np.testing.assert_allclose(spans[3], 1.0)
    middles = [item.vertices_m.mean(axis=0) for item in body_triangles(body)[:3]]
    np.testing.assert_allclose(middles, [[1.0, 2.0, 3.0]] * 3, atol=0.02)


def test_every_link_of_the_robot_has_a_picture(cycle):
    frames = robot_triangles(cycle.station.robot)
    assert len(frames) == 7
    assert all(frames)


def test_long_cycles_get_fewer_pictures_a_second():
    assert len(frame_times(10.0, 25.0, 4000)) == 251
    assert len(frame_times(1e4, 25.0, 4000)) == 4000
    assert len(set(order_colours(20))) == 20


def still_shot(tab, seconds=120):
    """The picture (rows, columns, 3) once it no longer changes: the page fades in slowly."""
    from PIL import Image

    end, before = time.monotonic() + seconds, None
    while True:
        image = np.asarray(Image.open(io.BytesIO(tab.shot())).convert("RGB"), dtype=float)
        now = image[100:380]
        if before is not None and np.mean(np.abs(now - before)) < 0.2 and colours(now) > 100:
            return now
        assert time.monotonic() < end, "the canvas stays blank or never comes to rest"
        before = now
        time.sleep(1.0)


def colours(image):
    return len({tuple(pixel) for pixel in image.reshape(-1, 3)[::7]})


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_browser_shows_a_scene_that_moves(page, tmp_path):
    with opened(page.as_uri(), tmp_path / "profile") as tab:
        tab.wait_for("document.querySelector('input') !== null")
        shots = []
        for moment in (1.2, 9.9, 1.2):
            assert tab.evaluate(SEEK % moment)
            time.sleep(2.0)
            shots.append(still_shot(tab))
        assert tab.console == []
    moved = [np.mean(np.abs(shots[0] - shot).max(axis=2) > 40) for shot in shots[1:]]
    assert 0.005 < moved[0] < 0.6, f"{moved[0]:.4f} of the picture changed"
    assert moved[1] < 0.1 * moved[0], "the same moment looks different the second time"
