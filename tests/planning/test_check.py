"""`check_station`: counts, reasons, warnings, and what stops it."""

import pytest
from test_station import SMALL, STUDS, write

from dmoc.errors import InputError
from planning.collision.coal_engine import CoalEngine
from planning.station.build import demo_station
from planning.welds.check import check_station

MASSES = "  mass_kg: 2\n  com_m: [0, 0, 0.05]\n"
PLAIN = SMALL.replace("  tip:", MASSES + "  tip:")


def checked(folder, text=PLAIN, studs=STUDS):
    return check_station(write(folder, text, studs))


def warnings(folder, text=PLAIN, studs=STUDS):
    found = checked(folder, text, studs)["warnings"]
    for doubt in found:
        assert doubt["file"].endswith("station.yaml")
        assert doubt["field"]
        assert doubt["value"]
        assert doubt["legal"]
        assert doubt["fix"]
    return {doubt["code"] for doubt in found} - {"poses-many"}  # two turns a joint


def test_a_sound_station_has_no_warnings(tmp_path):
    data = checked(tmp_path)
    assert [doubt["code"] for doubt in data["warnings"]] == ["poses-many"]
    assert data["errors"] == []
    assert all(row["alternatives"] > 0 and row["reason"] == "" for row in data["studs"])


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("mass_kg: 2", "mass_kg: 0", "tool-massless"),
        (
            "mass_kg: 2",
            "mass_kg: 0\n  inertia_kg_m2: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
            "tool-massless",
        ),
        (
            "mass_kg: 2",
            "mass_kg: 2\n  inertia_kg_m2: [[99, 0, 0], [0, 99, 0], [0, 0, 99]]",
            "tool-inertia",
        ),
        (", touches: true", "", "tool-touches"),
        ("tip: {position_m: [0, 0, 0.1]}", "tip: {position_m: [0, 0, 0.3]}", "tool-tip"),
        (SMALL[SMALL.index("  shapes:") : SMALL.index("  tip:")], "  shapes: []\n", "tool-bare"),
    ],
)
def test_doubtful_tools(tmp_path, old, new, code):
    assert old in PLAIN
    assert code in warnings(tmp_path, PLAIN.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("0.6,0.1,0.15", "0.6,0.1,0.4", "stud-floating"),
        ("0,0,2,1", "0,0,-2,1", "stud-normal"),
        ("0.7,-0.2,0.15", "0.6,0.1,0.15", "stud-twice"),
    ],
)
def test_doubtful_studs(tmp_path, old, new, code):
    assert warnings(tmp_path, studs=STUDS.replace(old, new)) == {code}


def test_the_other_engines_agree_or_are_named(tmp_path, monkeypatch):
    data = check_station(write(tmp_path, PLAIN), engines=True)
    assert [row["engine"] for row in data["engines"]] == ["coal", "fcl"]
    for row in data["engines"]:
        assert row["configurations"] > 60
        assert row["largest_m"] < 1e-3
        assert row["above_1_mm"] == row["touching"] == 0
    assert {doubt["code"] for doubt in data["warnings"]} <= {"poses-many"}
    # An engine that is 2 mm off is reported, with the pair.
    true = CoalEngine.distance

    def off(self, *arguments):
        found = true(self, *arguments)
        return found._replace(distance_m=found.distance_m + 0.002)

    monkeypatch.setattr(CoalEngine, "distance", off)
    data = check_station(write(tmp_path, PLAIN), engines=True)
    coal, fcl = data["engines"]
    assert coal["largest_m"] == pytest.approx(0.002, abs=1e-4)
    assert coal["above_1_mm"] > 0
    assert all(coal["worst"]["pair"])
    assert fcl["above_1_mm"] == 0
    (doubt,) = (d for d in data["warnings"] if d["code"] != "poses-many")
    assert doubt["code"] == "engines-disagree"
    assert "coal differs by up to 2.00 mm" in doubt["value"]


def test_a_load_that_the_drives_cannot_hold(tmp_path):
    heavy = PLAIN.replace("studs: studs.csv", "studs: studs.csv\npayload_kg: 200")
    with pytest.raises(InputError) as caught:
        checked(tmp_path, heavy)
    assert {fault.code for fault in caught.value.faults} == {"home-torque"}
    assert "joint 2" in str(caught.value)
    homeless = heavy[: heavy.index("home_rad")] + "home_rad: null\n"
    for row in checked(tmp_path, homeless)["studs"]:
        assert row["alternatives"] == 0
        assert "cannot hold the weight" in row["reason"]


def test_weld_poses_keep_what_the_certificate_demands(tmp_path):
    """With no clearance asked for, a pose 1 mm off is still none: no motion could start there."""
    low = PLAIN.replace("studs: studs.csv", "studs: studs.csv\nclearance_m: 0")
    # A post whose side is 1 mm beside the tool that stands upright on stud a (radius 1 cm).
    post = "  - {name: post, box_m: [0.1, 0.01, 0.05], pose: {position_m: [0.6, %s, 0.18]}}\n"
    near = low.replace("studs: studs.csv", post % 0.116 + "studs: studs.csv")
    far = low.replace("studs: studs.csv", post % 0.123 + "studs: studs.csv")
    row = checked(tmp_path, near)["studs"][0]
    assert row["alternatives"] == 0
    assert "collision with post" in row["reason"]
    assert checked(tmp_path, far)["studs"][0]["alternatives"] > 0


def test_check_says_how_deep_shapes_overlap_at_the_welds() -> None:
    """Stud S15 of station A is known to be welded with the tip inside the part's shapes."""
    station = demo_station("stud_welding_a")
    deep = {row["id"]: row["contact_depth_m"] for row in check_station(station.source)["studs"]}
    assert max(deep, key=deep.__getitem__) == "S15"
    assert 1e-3 < deep["S15"] < 5e-3
    assert sorted(deep.values())[-2] < 1e-4
