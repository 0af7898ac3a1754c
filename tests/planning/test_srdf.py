"""Allowed collisions from SRDF files: what they exempt, and what is wrong with bad ones."""

import numpy as np
import pytest
from scenes import box
from test_station import SMALL, write
from test_world import GUN, ROBOT

from dmoc.errors import InputError
from planning.collision.world import CollisionWorld, world_for
from planning.station.build import load_station
from planning.station.srdf import read_srdf

NAMES = {"base", "arm", "wrist", "table"}
LINKS = {"base", "arm", "wrist"}


def srdf(folder, body, root="robot name='r'"):
    path = folder / "r.srdf"
    path.write_text(f"<?xml version='1.0'?>\n<{root}>\n{body}\n</{root.split()[0]}>\n")
    return path


def test_pairs_defaults_and_exceptions(tmp_path):
    plain = "<disable_collisions link1='wrist' link2='arm' reason='Never'/>"
    group = "<group name='all'><link name='nowhere'/></group>"
    assert read_srdf(srdf(tmp_path, group + plain), NAMES, LINKS) == (("arm", "wrist"),)
    table = "<disable_collisions link1='base' link2='table'/>"
    assert read_srdf(srdf(tmp_path, table), NAMES, LINKS) == (("base", "table"),)
    default = "<disable_default_collisions link='wrist'/>"
    # A default exempts links against each other, never against what stands around them.
    assert read_srdf(srdf(tmp_path, default), NAMES, LINKS) == (("arm", "wrist"), ("base", "wrist"))
    taken_back = default + "<enable_collisions link1='wrist' link2='base'/>"
    assert read_srdf(srdf(tmp_path, taken_back), NAMES, LINKS) == (("arm", "wrist"),)
    assert read_srdf(srdf(tmp_path, ""), NAMES, LINKS) == ()


@pytest.mark.parametrize(
    ("body", "root", "codes"),
    [
        ("<disable_collisions link1='arm' link2='hand'/>", "robot", {"srdf-link"}),
        ("<disable_collisions link1='arm'/>", "robot", {"srdf-link"}),
        ("<disable_collisions link1='arm' link2='arm'/>", "robot", {"srdf-pair"}),
        ("<enable_collisions link1='moon' link2='arm'/>", "robot", {"srdf-link"}),
        ("<disable_default_collisions link='moon'/>", "robot", {"srdf-link"}),
        (
            "<disable_collisions link1='arm' link2='arm'/><disable_collisions link1='a'/>",
            "robot",
            {"srdf-pair", "srdf-link"},
        ),
        ("", "sdf", {"srdf-root"}),
        ("<broken", "robot", {"srdf-syntax"}),
        ("</robot><!DOCTYPE x []><robot>", "robot", {"srdf-syntax"}),
    ],
)
def test_faults_name_file_line_and_legal_names(tmp_path, body, root, codes):
    path = srdf(tmp_path, body, root)
    with pytest.raises(InputError) as caught:
        read_srdf(path, NAMES, LINKS)
    assert {fault.code for fault in caught.value.faults} == codes
    for fault in caught.value.faults:
        assert fault.file == str(path)
        assert fault.line
        assert fault.legal
        assert fault.fix
        assert "URDF" not in str(fault)


def test_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="file-missing"):
        read_srdf(tmp_path / "none.srdf", NAMES)


def test_a_world_leaves_the_pairs_out(tmp_path):
    shelf = box("shelf", (0.5, 0.5, 0.1), (0, 0, -2.0))
    plain = world_for(ROBOT, GUN, (shelf,))
    pair = next(p for p in plain.pairs if "shelf" not in p)
    path = srdf(tmp_path, f"<disable_collisions link1='{pair[0]}' link2='{pair[1]}'/>")
    world = world_for(ROBOT, GUN, (shelf,), srdf=path)
    assert set(plain.pairs) - set(world.pairs) == {pair}
    # A default exemption of a link keeps its check against the obstacle.
    path = srdf(tmp_path, f"<disable_default_collisions link='{pair[1]}'/>")
    world = world_for(ROBOT, GUN, (shelf,), srdf=path)
    assert [p for p in world.pairs if pair[1] in p] == [("shelf", pair[1])]
    # Links without a shape may be named: there is nothing to leave out.
    assert "flange" not in plain.scene.bodies
    path = srdf(tmp_path, f"<disable_collisions link1='flange' link2='{pair[1]}'/>")
    assert world_for(ROBOT, GUN, (shelf,), srdf=path).pairs == plain.pairs


def test_a_station_reads_it(tmp_path):
    before = load_station(write(tmp_path))
    pair = next(p for p in CollisionWorld(before).pairs if "table" not in p)
    srdf(tmp_path, f"<disable_collisions link1='{pair[0]}' link2='{pair[1]}'/>")
    after = load_station(write(tmp_path, SMALL + "srdf: r.srdf\n"))
    assert set(after.allowed_collisions) - set(before.allowed_collisions) == {tuple(sorted(pair))}
    assert pair not in CollisionWorld(after).pairs
    assert after.fingerprint != before.fingerprint
    srdf(tmp_path, "<disable_collisions link1='link_9' link2='tip'/>")
    with pytest.raises(InputError) as caught:
        load_station(write(tmp_path, SMALL + "srdf: r.srdf\n"))
    (fault,) = caught.value.faults
    assert (fault.code, fault.value, fault.line) == ("srdf-link", "link_9", 3)
    assert "link_1" in fault.legal
    assert "tip" in fault.legal
    for name, code in (("../r.srdf", "path-outside"), ("no.srdf", "file-missing")):
        with pytest.raises(InputError, match=code):
            load_station(write(tmp_path, SMALL + f"srdf: {name}\n"))


def test_the_engine_is_a_field_of_the_station(tmp_path):
    station = load_station(write(tmp_path, SMALL + "engine: fcl\n"))
    assert station.engine == "fcl"
    assert CollisionWorld(station).engine == "fcl"
    assert CollisionWorld(station, engine="coal").engine == "coal"
    plain = load_station(write(tmp_path))
    assert plain.home_rad is not None
    assert CollisionWorld(plain).engine == "native"
    assert plain.fingerprint != station.fingerprint
    q = np.array(plain.home_rad)
    one, other = (CollisionWorld(s).distance(q)[0] for s in (plain, station))
    assert one == pytest.approx(other, abs=1e-3)
    with pytest.raises(InputError, match="value-illegal"):
        load_station(write(tmp_path, SMALL + "engine: bullet\n"))
