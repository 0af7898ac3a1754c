"""The controller section of robot.yaml: the map, what it must say, and what it is held against."""

import numpy as np
import pytest
import yaml

from dmoc.errors import RobotError
from dmoc.robot.controller import controller_from_mapping, controller_text
from dmoc.robot.robot import load_robot

PLAIN = {"vendor": "abb", "coupling": "none"}


@pytest.mark.parametrize("coupling", ["none", "plus_axis_2", "minus_axis_2"])
def test_there_and_back(coupling):
    section = {"vendor": "kuka", "coupling": coupling, "sign": [-1, 1, 1, -1, 1, -1]}
    section["offset_deg"] = [0, -90, 90, 0, 0, 0]
    controller = controller_from_mapping(section, 6)
    q = np.random.default_rng(0).uniform(-3, 3, (50, 6))
    before = q.copy()
    np.testing.assert_allclose(controller.radians(controller.degrees(q)), q, atol=1e-12)
    np.testing.assert_array_equal(q, before)


def test_parallel_rods_hold_the_forearm():
    """ABB: with axis 2 moved, an unmoved axis 3 of the controller keeps the forearm's direction."""
    controller = controller_from_mapping({"vendor": "abb", "coupling": "plus_axis_2"}, 6)
    lean = np.radians([0.0, 30.0, -30.0, 0, 0, 0])  # URDF: the forearm turns back as the arm leans
    np.testing.assert_allclose(controller.degrees(lean), [0, 30, 0, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"vendor": "acme"}, "vendor"),
        ({"coupling": None}, "coupling"),
        ({"coupling": 1}, "coupling"),
        ({"sign": [1, 1, 1, 1, 1, 0]}, "sign"),
        ({"sign": [True] * 6}, "sign"),
        ({"offset_deg": [0, 0, 0]}, "offset_deg"),
        ({"offset_deg": [0, 0, 0, 0, 0, float("nan")]}, "offset_deg"),
        ({"limits_deg": [-170, 170]}, "limits_deg"),
        ({"home": {"urdf_deg": [0] * 6}}, "home"),
        ({"base": {"position": [0, 0, 1]}}, "base"),
        ({"tool0": {"quaternion_xyzw": [0, 0, 0, 0]}}, "tool0"),
        ({"zero": 1}, "zero"),
    ],
)
def test_what_is_wrong_is_named(change, field):
    with pytest.raises(RobotError) as caught:
        controller_from_mapping({**PLAIN, **change}, 6)
    assert {fault.field for fault in caught.value.faults} == {f"controller.{field}"}
    assert all(fault.legal and fault.fix for fault in caught.value.faults)


def test_the_commented_section_is_a_legal_one():
    lines = [line.removeprefix("# ") for line in controller_text(6).splitlines()]
    start = lines.index("controller:")
    section = yaml.safe_load("\n".join(lines[start:]))["controller"]
    assert controller_from_mapping(section, 6).vendor == "abb"


def with_section(tmp_path, text):
    shipped = load_robot("irb6640_class").urdf
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(shipped.read_text())
    settings = yaml.safe_load(shipped.with_name("robot.yaml").read_text())
    settings["controller"] = yaml.safe_load(text)
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(settings))
    return load_robot(urdf)


SHEET = "[[-170, 170], [-65, 85], [-180, 70], [-300, 300], [-120, 120], [-360, 360]]"


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        (f"{{vendor: abb, coupling: none, limits_deg: {SHEET}}}", []),
        (
            f"{{vendor: abb, coupling: none, offset_deg: [0, 0, 9, 0, 0, 0], limits_deg: {SHEET}}}",
            ["controller-limits"],
        ),
        (
            "{vendor: abb, coupling: none, home: {urdf_deg: [0, 20, 10, 0, 0, 0], "
            "controller_deg: [0, 20, 30, 0, 0, 0]}}",
            ["controller-home"],
        ),
        (
            "{vendor: abb, coupling: plus_axis_2, home: {urdf_deg: [0, 20, 10, 0, 0, 0], "
            "controller_deg: [0, 20, 30, 0, 0, 0]}}",
            [],
        ),
    ],
)
def test_the_map_is_held_against_data_sheet_and_pendant(tmp_path, text, codes):
    robot = with_section(tmp_path, text)
    warned = [d.code for d in robot.description.warnings if d.code.startswith("controller")]
    assert warned == codes


def test_the_map_changes_no_motion(tmp_path):
    robot = with_section(tmp_path, "{vendor: kuka, coupling: none, sign: [-1, 1, 1, -1, 1, -1]}")
    assert robot.fingerprint == load_robot("irb6640_class").fingerprint


def test_a_faulty_section_is_refused_with_its_line(tmp_path):
    with pytest.raises(RobotError) as caught:
        with_section(tmp_path, "{vendor: abb}")
    (fault,) = caught.value.faults
    assert (fault.field, fault.line is not None) == ("controller.coupling", True)
