"""What the paper says of its example's run, judged from physical events alone."""

from __future__ import annotations

from mrbt_mesh.drills.physical import Span, most_at_once, of
from tests.support.team import Team

TYPE_A = ("A1", "A2")
TYPE_B = ("B1", "B2")


def hold_for_the_paper(team: Team) -> None:
    """Before the team starts: nobody gets on with what the paper says is done side by side."""
    team.hold("use_screwdriver", *TYPE_A, *TYPE_B)


def go_on_as_in_the_paper(team: Team) -> None:
    """Let go as soon as all have begun who work side by side; a robot A is ready first."""
    team.wait_for_events(2, "use_screwdriver")
    team.release("use_screwdriver")
    team.wait_for_events(4, "do_diagnosis")
    team.hold("replace_hw")
    team.release("A1")
    team.wait_for_events(5, "do_diagnosis")
    team.release(*TYPE_A, *TYPE_B)
    team.wait_for_events(2, "replace_hw")
    team.release()


def check_order(work: list[Span]) -> None:
    """Holds with faults, too: what comes before what, and who may do it."""
    last_diagnosis = max(s.end_s for s in of(work, "do_diagnosis") if s.end == "success")
    repairs = [s for s in work if s.local_task in ("replace_hw", "replace_wires")]
    assert all(s.start_s >= last_diagnosis for s in repairs), "a repair before all diagnoses"
    assert {s.part for s in repairs} == {"2", "4"}
    assert {s.robot for s in of(work, "use_soldering_iron")} <= set(TYPE_B)
    for part in ("2", "4"):
        wires = of(work, "replace_wires", part)
        assert {s.robot for s in wires} <= {*TYPE_A, *TYPE_B}
        # A robot that died is there no more, though it never said so.
        assert most_at_once(s for s in wires if s.end is not None) <= 2, (
            f"more than two robots at the wires of {part}"
        )
    cover = [s for s in of(work, "move_frame") if s.end == "success"][-2:]
    screws = of(work, "use_screwdriver")[-1]
    assert screws.start_s >= max(s.end_s for s in cover), "screws before the cover"


def check_paper(work: list[Span]) -> None:
    """The run without a fault, as in section VI-A."""
    check_order(work)
    first_screws = [s for s in of(work, "use_screwdriver") if s.start_s < work[2].start_s]
    assert {s.robot for s in first_screws} == {"C1", "C2"}, "both C on the screws"
    diagnoses = of(work, "do_diagnosis")
    assert len(diagnoses) == 5
    at_once, fifth = diagnoses[:4], diagnoses[4]
    assert {s.robot for s in at_once} == {*TYPE_A, *TYPE_B}
    assert all(a.overlaps(b) for a in at_once for b in at_once)
    assert fifth.start_s >= min(s.end_s for s in at_once), "the fifth waits for a free robot"
    assert fifth.robot in TYPE_A, "the first that is free is an A"
    hardware = of(work, "replace_hw")
    assert {s.part for s in hardware} == {"2", "4"}
    assert {s.robot for s in hardware} == set(TYPE_A)
    for span in work:
        if span.robot in TYPE_B and span.local_task != "do_diagnosis":
            busy = [h for h in hardware if h.overlaps(span) and h.part == span.part]
            assert not busy, "a B works on a part whose hardware is being replaced"
    first_done = min(h.end_s for h in hardware)
    early = [s for s in work if s.robot in TYPE_B and s.local_task != "do_diagnosis"]
    assert all(s.start_s >= first_done for s in early), "both B rest during the hardware"
