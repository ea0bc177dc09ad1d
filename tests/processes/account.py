"""What the paper says of its example's run, judged from physical events alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

TYPE_A = ("A1", "A2")
TYPE_B = ("B1", "B2")


@dataclass(frozen=True)
class Stint:
    """One robot's work on one local task, from start to end or cancellation."""

    robot: str
    local_task: str
    args: tuple[str, ...]
    start_s: float
    end_s: float
    how: str

    def overlaps(self, other: Stint) -> bool:
        return self.start_s < other.end_s and other.start_s < self.end_s


def stints(events: Iterable[dict[str, Any]]) -> list[Stint]:
    """Events paired to stints, by start. A stint that never ended (killed) ends at infinity."""
    open_: dict[tuple[str, str], dict[str, Any]] = {}
    found = []
    for event in sorted(events, key=lambda event: event["t"]):
        key = (event["robot"], event["incarnation"])
        if event["event"] == "start":
            assert key not in open_, f"{key} started a second task: {event}"
            open_[key] = event
            continue
        begun = open_.pop(key)
        assert begun["activation"] == event["activation"]
        found.append(_stint(begun, event["t"], event["outcome"] or event["event"]))
    found += [_stint(event, float("inf"), "lost") for event in open_.values()]
    return sorted(found, key=lambda stint: stint.start_s)


def _stint(begun: dict[str, Any], end_s: float, how: str) -> Stint:
    args = tuple(str(value) for value in begun["args"])
    return Stint(begun["robot"], begun["local_task"], args, begun["t"], end_s, how)


def of(work: list[Stint], local_task: str, *args: str) -> list[Stint]:
    """The stints of a local task, with these arguments if any are given."""
    return [s for s in work if s.local_task == local_task and (not args or s.args == args)]


def check_order(work: list[Stint]) -> None:
    """Holds with faults, too: what comes before what, and who may do it."""
    last_diagnosis = max(s.end_s for s in of(work, "do_diagnosis") if s.how == "success")
    repairs = [s for s in work if s.local_task in ("replace_hw", "replace_wires")]
    assert all(s.start_s >= last_diagnosis for s in repairs), "a repair before all diagnoses"
    assert {s.args[0] for s in repairs} == {"2", "4"}
    assert {s.robot for s in of(work, "use_soldering_iron")} <= set(TYPE_B)
    for part in ("2", "4"):
        wires = of(work, "replace_wires", part)
        assert {s.robot for s in wires} <= {*TYPE_A, *TYPE_B}
        for stint in wires:
            at_once = [s for s in wires if s.start_s <= stint.start_s < s.end_s]
            assert len(at_once) <= 2, f"more than two robots at the wires of {part}"
    cover = [s for s in of(work, "move_frame") if s.how == "success"][-2:]
    screws = of(work, "use_screwdriver")[-1]
    assert screws.start_s >= max(s.end_s for s in cover), "screws before the cover"


def check_paper(work: list[Stint]) -> None:
    """The run without a fault, as section VI-A tells it."""
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
    assert {(s.args[0]) for s in hardware} == {"2", "4"}
    assert {s.robot for s in hardware} == set(TYPE_A)
    for stint in work:
        if stint.robot in TYPE_B and stint.local_task != "do_diagnosis":
            busy = [h for h in hardware if h.overlaps(stint) and h.args == stint.args]
            assert not busy, "a B works on a part whose hardware is being replaced"
    first_done = min(h.end_s for h in hardware)
    early = [s for s in work if s.robot in TYPE_B and s.local_task != "do_diagnosis"]
    assert all(s.start_s >= first_done for s in early), "both B rest during the hardware"
