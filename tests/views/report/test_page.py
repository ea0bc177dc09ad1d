"""The Gantt chart: where its bars are, and names that come from files."""

from __future__ import annotations

import html
import itertools
import re
from dataclasses import replace
from xml.etree import ElementTree

import pytest

from mrbt_mesh.views.report.gantt import LEFT, WIDTH, gantt, kinds, ticks
from mrbt_mesh.views.report.model import (
    Disagreement,
    Proof,
    ReportedCommand,
    ReportedFailure,
    ReportedFault,
    ReportedJob,
    ReportedPlan,
    ReportedWork,
    RobotUse,
    RunIdentity,
    RunParts,
    RunReport,
    TaskEnd,
)
from mrbt_mesh.views.report.page import report_html

HOSTILE = "<b onload=x>|`&\"'"
RUN = RunReport(
    "run",
    "explore",
    "success",
    20.0,
    (RobotUse("A1", "A", "dead", 10.0, 4.0, 1.0, 0), RobotUse("B1", "B", "alive", 20.0, 5.0, 0, 1)),
    (ReportedFault("A1", 10.0, None, (), 50_000, 1_000_000, "scan(1)", "B1"),),
    (TaskEnd("look", "success", ("B1",)),),
    (
        ReportedWork("A1", "look", "scan(1)", 5.0, 6.0, 10.0, "died"),
        ReportedWork("B1", "look", "scan(1)", 10.5, 11.0, 16.0, "done"),
        ReportedWork("B1", "look", "move", 16.0, None, 16.5, "dropped"),
    ),
)


def bars(run: RunReport, kind: str) -> list[tuple[float, float]]:
    """From when to when, in s, as the bars of this class are drawn."""
    svg = ElementTree.fromstring(gantt(run))
    found = [rect for rect in svg.iter("rect") if kind in rect.attrib["class"].split()]
    scale = run.duration_s / (WIDTH - LEFT - 8)
    spans = [(float(r.attrib["x"]) - LEFT, float(r.attrib["width"])) for r in found]
    return [(x * scale, (x + width) * scale) for x, width in spans]


def test_bars_are_drawn_to_scale() -> None:
    for kind, wanted in (
        ("work", [(6, 10), (11, 16)]),
        ("starting", [(5, 6), (10.5, 11), (16, 16.5)]),
        ("away", [(10, 20)]),
        ("detection", [(10, 10.05)]),
        ("takeover", [(10.05, 11)]),
    ):
        assert bars(RUN, kind) == [pytest.approx(each, abs=0.02) for each in wanted], kind


def test_a_robot_that_is_back_is_away_only_until_then() -> None:
    back = replace(RUN, faults=(replace(RUN.faults[0], until_s=14.0),))
    assert bars(back, "away") == [pytest.approx((10, 14), abs=0.02)]


def test_every_local_task_has_its_colour() -> None:
    assert kinds(RUN) == ["scan", "move"]


def test_without_work_there_is_no_chart() -> None:
    assert gantt(replace(RUN, work=None)) == gantt(replace(RUN, duration_s=0.0)) == ""


@pytest.mark.parametrize("duration_s", [0.004, 0.3, 1, 7, 25.5, 60, 999, 86_400])
def test_ticks_are_round_and_few(duration_s: float) -> None:
    found = ticks(duration_s)
    steps = {round(b - a, 6) for a, b in itertools.pairwise(found)}
    assert found[0] == 0
    assert 4 <= len(found) - 1 <= 10
    assert len(steps) == 1
    assert found[-1] <= duration_s < found[-1] + max(steps) * 1.001


def test_names_from_files_mean_nothing_to_html() -> None:
    run = RunReport(
        HOSTILE,
        HOSTILE,
        HOSTILE,
        20.0,
        (RobotUse(HOSTILE, HOSTILE, HOSTILE, 10.0, 4.0, 1.0, 0),),
        (ReportedFault(HOSTILE, 1.0, None, (), None, None, HOSTILE, HOSTILE, HOSTILE),),
        (TaskEnd(HOSTILE, HOSTILE, (HOSTILE,)),),
        (ReportedWork(HOSTILE, HOSTILE, HOSTILE, 5.0, 6.0, 10.0, "died"),),
        notes=(HOSTILE,),
        failures=(ReportedFailure(HOSTILE, HOSTILE, HOSTILE, 7.0, HOSTILE),),
    )
    report = RunParts((run, run))
    page = report_html(report)
    assert "<b onload" not in page
    ElementTree.fromstring(page[page.index("<main>") : page.index("</main>") + 7])


def test_who_agreed_on_which_plan_when() -> None:
    plans = (
        ReportedPlan(1, "0a0b0c0d", 0.5, 0.5, 10.0, {"A1": 0.5, "B1": 0.5}),
        ReportedPlan(2, "1a1b1c1d", 10.0, None, 10.1, {"A1": 10.0}),
        ReportedPlan(3, "2a2b2c2d", 10.1, 10.15, 20.0, {"A1": 10.1, "B1": 10.15}),
    )
    run = replace(RUN, plans=plans, differences=(Disagreement(10.0, 10.15, ("A1",)),))
    text = report_html(RunParts((run,))).split("<h2>Agreement")[1]
    rows = [re.sub("<[^>]+>", "|", row) for row in text.split("<tr>")]
    assert "3 plans; all robots agreed on 2 of them, after 25 ms (≤ 50 ms)" in text
    for row in (
        "|2 (1a1b1c1d)||10.00 s||A1||not before the next plan||–|",
        "|3 (2a2b2c2d)||10.10 s||A1||50 ms||B1|",
        "|10.00 s||150 ms||A1|",
    ):
        assert any(each.startswith(row) for each in rows), row
    # Where nobody recorded what robots reported, there is no such section.
    assert "<h2>Agreement" not in report_html(RunParts((RUN,)))


def test_an_incident_has_its_date_clock_version_digest_commands_and_verification() -> None:
    identity = RunIdentity(1_795_641_208.552, "64cf970d", "5c96016d", "0.1.0")
    findings = ("run.mcap: record 3: wrong",)
    proof = Proof(("run.mcap",), "0123456789abcdef01", {"facts": 1692}, findings, ("cut",))
    commands = (
        ReportedCommand(6.685, "mrbt kill", "A1 (pid 7) killed", "root"),
        ReportedCommand(7.0, "mrbt kill", "D2 killed", ""),
    )
    run = replace(RUN, identity=identity, proof=proof, commands=commands)
    text = report_html(RunParts((run,)))
    for wanted in (
        "2026-11-25 21:13:28.552 to 21:13:48.552 UTC",
        *("64cf970d", "5c96016d", "0.1.0", "CONTRADICTED: 1 findings"),
        "21:13:38.552",  # of the fault
        *("21:13:35.237", "mrbt kill", "A1 (pid 7) killed"),
        "Checked: 1,692 facts.",
        "whose key is 0123456789abcdef.",
        *("run.mcap: record 3: wrong", "cut"),
    ):
        assert wanted in text, wanted
    gaps = replace(run, proof=replace(proof, findings=()))
    assert "not contradicted, and not all is proved: gaps: 1" in report_html(RunParts((gaps,)))
    simulated = replace(run, identity=replace(identity, began_unix_s=None))
    assert "simulated, in virtual time" in report_html(RunParts((simulated,)))


def test_jobs_are_listed_and_a_run_without_any_has_no_table() -> None:
    assert "<h2>Jobs</h2>" not in report_html(RunParts((RUN,)))
    done = ReportedJob(
        "j1", f"fetch({HOSTILE})", 2, 1.0, 2.5, 9.25, ("A1", "B1"), "succeeded", "", ""
    )
    old = ReportedJob("j0", "look", None, None, None, None, (), "failed", "no cup", "op")
    many = (old, done, *(replace(done, id=f"k{n}") for n in range(199)))
    page = report_html(RunParts((replace(RUN, jobs=many),)))
    table = page[page.index("<h2>Jobs</h2>") :]
    table = table[: table.index("</section>")]
    rows = [re.findall("<td[^>]*>(.*?)</td>", row) for row in table.split("<tr>")[2:4]]
    times = ["1.00 s", "2.50 s", "9.25 s"]
    what = f"fetch({html.escape(HOSTILE)})"
    assert rows == [
        ["j0", "look", "–", "–", "–", "–", "–", "failed: no cup"],
        ["j1", what, "2", *times, "A1, B1", "succeeded"],
    ]
    assert "1 later ones: see --json" in table
    assert HOSTILE not in page
