"""Tables, pictures, the report page and the progress line."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from sample_cycle import sample_cycle

from sequencing.report.curves import curves_png, plot_cycle
from sequencing.report.html import report_html, write_report
from sequencing.report.markup import markdown_html
from sequencing.report.progress import ProgressText, plan_progress
from sequencing.runs.clock import timeline
from sequencing.runs.folder import read_run, write_run
from sequencing.runs.result import result_of
from sequencing.runs.tables import tables_markdown
from studies.stud_welding.paper import paper_tables


@pytest.fixture(scope="module")
def cycle():
    return sample_cycle()


@pytest.fixture(scope="module")
def run(cycle, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    write_run(cycle, folder, {})
    return read_run(folder)


def test_bjorkenstam2014_tables_agree_with_themselves():
    paper = paper_tables()
    assert sum(row[1] for row in paper["studs"]) == 307
    assert len(paper["studs"]) == 20
    for name in ("old_sequence", "new_sequence"):
        row = paper[name]
        assert row["travel"] + row["welding"] == pytest.approx(row["total"], abs=0.11)
    lowest = sum(row[2] for row in paper["studs"])
    highest = sum(row[3] for row in paper["studs"])
    assert lowest < paper["new_sequence"]["welding"] < paper["old_sequence"]["welding"] < highest


def test_tables_are_of_this_station_alone_and_name_what_is_assumed(cycle):
    text = tables_markdown(result_of(cycle, {}))
    rows = {line.split("|")[1].strip(): line for line in text.splitlines() if line[:1] == "|"}
    new = [cell.strip() for cell in rows["new sequence (optimal control)"].split("|")[2:-1]]
    ours = cycle.tables.energy_based
    assert new == [f"{x:.1f}" for x in (ours.travel, ours.welding, ours.total)]
    assert f"{cycle.tables.saving_percent:.1f}" in rows["saving %"]
    # The paper's studs are not these: its figures stand in the study only.
    assert "paper" not in text.lower()
    assert "Assumed, not measured" in text
    assert "inertia" in text
    assert "S9 (joint limit (12))" in text
    assert "not proven" not in text
    assert "Strict gap 80.0 %" in text
    assert "Conditional gap 2.50 %" in text
    assert "Coverage 90.9 %" in text
    assert "judged by 10 edges" in text


def test_an_unproven_bound_is_not_called_proven(cycle):
    result = json.loads(json.dumps(result_of(cycle, {})))
    result["search"] |= {"bound_is_proven": False}
    assert "(not proven)" in tables_markdown(result)


def test_motions_below_the_demanded_clearance_are_named_and_others_are_not(cycle):
    result = json.loads(json.dumps(result_of(cycle, {})))
    assert result["clearance_m"] == cycle.station.clearance_m
    for entry in result["motions"]:
        entry["proven_clearance_m"] = result["clearance_m"]
    assert "Warning" not in tables_markdown(result)
    result["motions"][1]["proven_clearance_m"] = 0.0073
    text = tables_markdown(result)
    assert "1 motions keep less than the" in text
    assert f"{result['motions'][1]['key']} 7.3 mm" in text
    assert f"{result['motions'][0]['key']} " not in text.split("(proven:")[1].split(")")[0]


def test_every_row_of_a_table_has_all_columns(cycle):
    for block in tables_markdown(result_of(cycle, {})).split("\n\n"):
        if block.startswith("|"):
            assert len({line.count("|") for line in block.splitlines()}) == 1, block


def test_the_curves_are_shares_of_the_limits_with_the_welds_shaded(cycle):
    line = timeline(cycle.welds, cycle.motions)
    robot = cycle.station.robot
    position, velocity, torque = plot_cycle(line, robot).axes
    assert len([p for p in position.patches if p.get_width() == pytest.approx(2.0)]) == 3
    curve = velocity.lines[0]
    names = [item.get_label() for item in velocity.lines[:6]]
    assert names == list(robot.model.names)[1:]
    peak = (
        max(np.max(np.abs(m.motion.trajectory.velocity_rad_s[:, 0])) for m in cycle.motions)
        / robot.velocity_limit_rad_s[0]
    )
    assert np.max(np.abs(curve.get_ydata())) == pytest.approx(peak, rel=0.02)
    assert torque.get_ylim()[1] >= 1.0


def test_equal_cycles_give_equal_pictures(cycle):
    line = timeline(cycle.welds, cycle.motions)
    first, second = (curves_png(line, cycle.station.robot, dpi=40) for _ in range(2))
    assert first == second
    assert first.startswith(b"\x89PNG")


class _Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.open, self.links = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)
        self.links += [v for k, v in attrs if k in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_report_is_one_page_that_needs_nothing(run, cycle, tmp_path):
    path = write_report(run, cycle.station.robot, tmp_path / "report.html")
    page = _Page(path.read_text(encoding="utf-8"))
    assert page.open == []
    assert [link for link in page.links if not link.startswith("data:")] == ["scene.html"]
    text = re.sub(r"data:[^\"]+", "", path.read_text())
    assert "http" not in text
    assert "S1 (alternative 1) → S3" in text
    assert run.result["inputs"]["station_fingerprint"] in text


def test_names_from_files_are_escaped(run, cycle):
    evil = dict(run.result) | {"name": "<script>alert(1)</script>"}
    page = report_html(type(run)(run.folder, evil, run.motions, run.welds), cycle.station.robot)
    assert "<script>" not in page


def test_markdown_of_tables_becomes_html():
    html = markdown_html(
        "# A & B\n\ntext **bold** <i>\n\n| a | b |\n| --- | ---: |\n| 1 | 2 |\n\n- x\n- y"
    )
    assert html.splitlines()[0] == "<h1>A &amp; B</h1>"
    assert "<p>text <strong>bold</strong> &lt;i&gt;</p>" in html
    assert "<tr><td>1</td><td>2</td></tr>" in html
    assert "<ul><li>x</li><li>y</li></ul>" in html


def event(phase, best=None, gap=None, edges=None):
    return SimpleNamespace(phase=phase, best=best, gap=gap, edges=edges)


EDGES = SimpleNamespace(done=12, failed=3, left=5, reused=2, quality="screen")


def test_progress_says_done_failed_best_gap_and_left():
    text = ProgressText()
    text.take(event("edges", edges=EDGES))
    text.take(event("search", best=1197.34, gap=0.028))
    assert text.title == "searching the order"
    for part in ("12 done", "3 failed", "5 left", "2 from the store", "best 1197.3", "2.8 %"):
        assert part in text.numbers
    text.take(event("edges", edges=EDGES))
    assert text.phase == "search"


def test_progress_goes_to_stderr_and_only_when_it_says_something_new(capsys):
    with plan_progress(live=False) as callback:
        for item in [
            event("alternatives"),
            *[event("edges", edges=EDGES)] * 50,
            event("search", 5.0),
        ]:
            callback(item)
    out, err = capsys.readouterr()
    assert out == ""
    assert 2 <= len(err.splitlines()) <= 4


def test_the_live_line_takes_events(capsys):
    with plan_progress(live=True) as callback:
        callback(event("edges", edges=EDGES))
        callback(event("search", best=5.0, gap=0.1))
    assert capsys.readouterr().out == ""
