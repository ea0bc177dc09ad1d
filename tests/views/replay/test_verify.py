"""Recordings of good runs are proved, whatever befell them; falsified ones are found and named."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.facts.records import Proposal, ProposedStep
from mrbt_mesh.core.facts.store import parse_entry
from mrbt_mesh.recording.channels import ACTIONS, ALIVE, DROPPED, FACTS, LIFE, PLANS, STATUSES
from mrbt_mesh.recording.messages import pack_fact, unpack_fact
from mrbt_mesh.recording.reader import RecordedMessage, Recording, RecordingError, parse_recording
from mrbt_mesh.sim import AgentOptions, Freeze, Kill, Leave, Lose, Schedule, Thaw
from mrbt_mesh.sim.run import run_scenario, simulate
from mrbt_mesh.views.replay.findings import Verification
from mrbt_mesh.views.replay.verify import verify
from tests.support.depot import depot, worker
from tests.support.effort import at_size
from tests.support.falsify import falsify, write_again
from tests.support.recorded import read_all, record_chaos, record_example
from tests.support.runs import source

pytestmark = pytest.mark.timeout(900)

CHAOS_SEEDS = at_size(quick=2, gate=40, long=200)
FALSIFICATIONS = at_size(quick=12, gate=100, long=200)
FAULTS: dict[str, Schedule] = {
    "none": (),
    "death": ((12_500_000, Kill("A1")),),
    "freeze": ((3_000_000, Freeze("B1")), (8_000_000, Thaw("B1"))),
    "minor": ((4_000_000, Lose("A1", "do_diagnosis")),),
    "leave": ((6_000_000, Leave("B1")),),
}


@pytest.fixture(scope="module")
def repaired(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    """The recordings of a run in which a robot died at work."""
    folder = tmp_path_factory.mktemp("repaired")
    record_example(folder, "vehicle_repair", 7, FAULTS["death"])
    return read_all(folder)


def proved(recordings: list[Recording], where: str = "") -> Verification:
    verdict = verify(recordings)
    assert not verdict.findings, where + "\n" + "\n".join(map(str, verdict.findings[:10]))
    return verdict


@pytest.mark.parametrize("fault", FAULTS)
def test_a_run_is_proved_with_its_takeovers(tmp_path: Path, fault: str) -> None:
    record_example(tmp_path, "vehicle_repair", 7, FAULTS[fault])
    verdict = proved(read_all(tmp_path))
    for counted in ("facts", "plans", "statuses", "lines", "claims", "actions"):
        assert verdict.counts[counted] > 0
    causes = {each.cause for each in verdict.takeovers}
    if fault == "death":
        assert causes == {"A1 is dead"}
    if fault == "none":
        assert causes == set()


@pytest.mark.slow
def test_plans_that_were_made_apart_are_proved(tmp_path: Path) -> None:
    late = AgentOptions(plan_delay_us=20_000)
    record_example(tmp_path, "vehicle_repair", 4, FAULTS["death"], late)
    proved(read_all(tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("part", range(min(4, CHAOS_SEEDS)))
def test_no_false_alarm_in_chaos(tmp_path: Path, part: int) -> None:
    for number in range(part, CHAOS_SEEDS, 4):
        folder = tmp_path / str(number)
        _, manifest = record_chaos(folder, number)
        verdict = verify(read_all(folder), manifest)
        assert verdict.is_proved, (number, verdict.findings[:5], verdict.gaps)


@pytest.mark.slow
@pytest.mark.parametrize("number", [146, 119])
def test_what_comes_again_at_one_time_or_later_is_no_finding(tmp_path: Path, number: int) -> None:
    """An own outcome that comes back from a slower robot; a death and a life at one time."""
    _, manifest = record_chaos(tmp_path, number)
    verdict = verify(read_all(tmp_path), manifest)
    assert verdict.is_proved, (verdict.findings[:5], verdict.gaps)


def test_a_robot_that_catches_up_has_given_up_what_its_plan_still_says(tmp_path: Path) -> None:
    mission, program = source(None).load(82)
    run_scenario(mission, program, source(None).scenario(82, mission), record=tmp_path)
    recordings = read_all(tmp_path)
    told = {r.data["event"] for each in recordings for r in each.records if r.topic == LIFE}
    assert {"catches_up", "caught_up"} <= told
    proved(recordings)


def test_a_robot_that_is_alone_and_joins_again_in_the_step_in_which_it_is_fenced(
    tmp_path: Path,
) -> None:
    faults = (
        (1_700_000, Leave("R2")),
        (6_100_000, Freeze("R1")),
        (11_000_000, Thaw("R1")),
    )
    record_example(tmp_path, "explore", 25, faults)
    proved(read_all(tmp_path))


def test_ways_are_proved_and_are_no_work(tmp_path: Path) -> None:
    mission = depot("Parallel: {success: all, children: [scan_at(a), lift_at(b), lift_at(a)]}")
    simulate(mission, worker(), seed=1, schedule=[(7_000_000, Kill("R2"))], record=tmp_path)
    recordings = read_all(tmp_path)
    proved(recordings)
    r1 = next(each for each in recordings if each.metadata.robot == "R1")
    records = list(r1.records)
    at, way = next((i, r) for i, r in enumerate(records) if "travel_to" in r.data)
    work = {name: value for name, value in way.data.items() if name != "travel_to"}
    records[at] = replace(way, data=work)
    path = tmp_path / r1.name
    write_again(replace(r1, records=tuple(records)), path)
    others = [each for each in recordings if each is not r1]
    verdict = verify([parse_recording(path.read_bytes(), path), *others])
    assert any("claims something else" in each.text for each in verdict.findings), texts(verdict)


@pytest.mark.slow
def test_random_falsifications_are_all_found_and_named(
    repaired: list[Recording], tmp_path: Path
) -> None:
    proved(repaired)
    tried, wanted = 0, FALSIFICATIONS
    begin = random.randrange(1 << 32)
    for seed in range(begin, begin + 10 * wanted):
        index = seed % len(repaired)
        falsified = falsify(repaired[index], tmp_path, seed)
        if falsified is None:
            continue
        tried += 1
        name = repaired[index].name
        where = f"falsify(repaired[{index}], folder, {seed}): {name} {falsified}"
        others = [each for each in repaired if each is not repaired[index]]
        verdict = verify([falsified.recording, *others])
        named = {(finding.file, finding.record) for finding in verdict.findings}
        assert (name, falsified.record) in named, f"{where}\n{verdict.findings[:5]}"
        if tried == wanted:
            return
    pytest.fail(f"only {tried} falsifications from {begin}")


# -- one falsification of each kind, with all checks made anew ------------------------------------


Records = list[RecordedMessage]


def other(records: Records, topic: str, change: dict[str, Any], **having: Any) -> Records:
    """With a change in the first message on the topic that has these values."""
    found = next(r for r in records if r.topic == topic and having.items() <= dict(r.data).items())
    changed = replace(found, data={**found.data, **change})
    return [changed if each is found else each for each in records]


def repeated(records: Records) -> Records:
    at = next(i for i, each in enumerate(records) if each.topic == ALIVE)
    return [*records[: at + 1], *records[at:]]


def dropped(records: Records) -> Records:
    """With the first fact dropped just after it was recorded."""
    at = next(i for i, each in enumerate(records) if each.topic == FACTS)
    data = {name: records[at].data[name] for name in ("number", "author", "name")}
    return [*records[: at + 1], replace(records[at], topic=DROPPED, data=data), *records[at + 1 :]]


def idle(records: Records) -> Records:
    plan = next(r for r in records if r.topic == PLANS and "B1" in r.data["lines"])
    lines = {robot: line for robot, line in plan.data["lines"].items() if robot != "B1"}
    return other(records, PLANS, {"lines": lines}, number=plan.data["number"])


def without_claim(records: Records) -> Records:
    own = {"author": "B1", "name": "claim"}
    at = next(i for i, r in enumerate(records) if own.items() <= dict(r.data).items())
    return [*records[:at], *records[at + 1 :]]


STARTED = {"event": "started"}
FORGERIES: dict[str, Callable[[Records], Records]] = {
    "B1 starts do_diagnosis.1. of .*, which its plan does not give it": lambda records: other(
        records, ACTIONS, {"local_task": "do_diagnosis(1)"}, **STARTED
    ),
    "B1 starts .*, and claims something else": lambda records: other(
        records, ACTIONS, {"coalition": "77"}, **STARTED
    ),
    "B1 claims .*; its plan gives it": without_claim,
    "the plan does not follow from its facts: other lines": idle,
    "the plan's alive set is not the one recorded before it": lambda records: other(
        records, PLANS, {"alive": {}}
    ),
    "statuses of a plan that was not made just before": lambda records: other(
        records, STATUSES, {"plan": 77}
    ),
    "the statuses of T_G's nodes do not follow from the facts": lambda records: other(
        records, STATUSES, {"nodes": "S"}
    ),
    "the alive set is recorded again, but has not changed": repeated,
    "is dropped, and still needed": dropped,
}


@pytest.mark.slow
@pytest.mark.parametrize("finding", FORGERIES)
def test_what_an_able_forger_changes_is_found(
    repaired: list[Recording], tmp_path: Path, finding: str
) -> None:
    """Once for each check, with all checks of the file made anew."""
    b1 = next(each for each in repaired if each.metadata.robot == "B1")
    path = tmp_path / b1.name
    write_again(replace(b1, records=tuple(FORGERIES[finding](list(b1.records)))), path)
    verdict = verify(
        [parse_recording(path.read_bytes(), path), *[r for r in repaired if r is not b1]]
    )
    found = [each for each in verdict.findings if re.search(finding, each.text)]
    assert found, texts(verdict)
    assert found[0].file == "B1.mcap"


@pytest.mark.parametrize(
    ("kept", "finding"),
    [
        (0, "the plan was made with facts that should have been dropped"),
        (1, "should have been dropped before, with others"),
    ],
)
def test_facts_that_no_node_reads_any_more_must_be_dropped(
    tmp_path: Path, kept: int, finding: str
) -> None:
    mission, program = source(None).load(11)
    run_scenario(mission, program, source(None).scenario(11, mission), record=tmp_path)
    first = read_all(tmp_path)[0]
    drops = [each for each in first.records if each.topic == DROPPED]
    assert len(drops) == 2, "the run is another one: find a seed anew"
    records = tuple(each for each in first.records if each not in drops[kept:])
    write_again(replace(first, records=records), tmp_path / "forged.mcap")
    forged = tmp_path / "forged.mcap"
    assert finding in texts(verify([parse_recording(forged.read_bytes(), forged)]))


def texts(verdict: Verification) -> str:
    return "\n".join(map(str, verdict.findings))


def test_a_fact_that_was_told_before_its_author_said_it(
    repaired: list[Recording], tmp_path: Path
) -> None:
    """It is a true one of later on: no other recording contradicts it."""
    falsified = falsify(repaired[5], tmp_path, 2005687262)
    assert falsified is not None
    true, false = (
        each.records[falsified.record - 1] for each in (repaired[5], falsified.recording)
    )
    later = [
        each
        for each in repaired[5].records[false.number :]
        if {**each.data, "number": 0} == {**false.data, "number": 0}
    ]
    assert len(later) == 1, f"the run is another one: find a seed anew; {true} -> {false}"
    told = texts(verify([falsified.recording, *repaired[:5], *repaired[6:]]))
    text = f"it does not fit record {later[0].number}: one of them is false"
    assert f"C2.mcap: record {false.number}: {text}" in told


def test_a_fact_that_its_author_never_said_is_contradicted(
    repaired: list[Recording], tmp_path: Path
) -> None:
    """Facts and plans of one recording alone fit together; the author's own does not fit them."""
    a2, rest = repaired[1], [each for each in repaired if each is not repaired[1]]
    verdict = verify([parse_recording(a2.path.read_bytes(), a2.path), *rest])
    assert not verdict.findings
    last = [each for each in a2.records if each.topic == FACTS][-1]
    without = replace(a2, records=tuple(each for each in a2.records if each != last))
    others = [each for each in rest if each.metadata.robot != "A2"]
    path = tmp_path / a2.name
    write_again(without, path)
    told = verify([parse_recording(path.read_bytes(), path), *others])
    if last.data["author"] == "A2":
        assert "A2 has not recorded that it said" in texts(told)
    else:
        assert told.findings or last.number == a2.records[-1].number


def test_a_killed_robots_recording_is_noted_and_proved(
    repaired: list[Recording], tmp_path: Path
) -> None:
    content = repaired[0].path.read_bytes()
    cut = parse_recording(content[: content.rindex(b',"check":"')], tmp_path / "A1.mcap")
    verdict = proved([cut, *repaired[1:]])
    assert [gap.kind for gap in verdict.gaps] == ["unsigned"]


def test_recordings_of_different_runs_are_refused(
    repaired: list[Recording], tmp_path: Path
) -> None:
    record_example(tmp_path, "explore", 1)
    with pytest.raises(RecordingError, match="are of different runs"):
        verify([repaired[0], *read_all(tmp_path)])


def scheduled(folder: Path) -> list[Recording]:
    """The recordings of a team that looks ahead."""
    tree = "Parallel: {success: all, children: [scan_at(a), scan_at(b), lift_at(a), lift_at(b)]}"
    simulate(depot(tree), worker(), seed=1, record=folder)
    return read_all(folder)


def exchanged(records: Records) -> Records:
    """In each robot's recording all proposals have R1 and R3 exchanged."""
    swap = {"R1": "R3", "R3": "R1"}

    def other_way(record: RecordedMessage) -> RecordedMessage:
        if record.topic != FACTS or record.data["name"] != "schedule":
            return record
        entry = unpack_fact(record.data)
        assert isinstance(entry.record, Proposal)
        steps = tuple(
            ProposedStep(
                step.activation, tuple(tuple(swap.get(r, r) for r in x) for x in step.robots)
            )
            for step in entry.record.steps
        )
        value = Proposal(steps).to_value()
        forged = parse_entry(entry.author, entry.name, entry.version, value)
        return replace(record, data=pack_fact(forged, record.data["number"]))

    return [other_way(each) for each in records]


def rewritten(
    recording: Recording, change: Callable[[Records], Records], folder: Path
) -> Recording:
    path = folder / recording.name
    path.unlink(missing_ok=True)
    write_again(replace(recording, records=tuple(change(list(recording.records)))), path)
    return parse_recording(path.read_bytes(), path)


def test_what_was_done_follows_the_schedules(tmp_path: Path) -> None:
    recordings = scheduled(tmp_path)
    proved(recordings)
    # All recordings agree on what was proposed, but nobody went by it.
    forged = [rewritten(each, exchanged, tmp_path) for each in recordings]
    found = texts(verify(forged))
    assert re.search("the plan does not follow from its facts: other .*lines", found), found
    assert "differs from the other recordings" not in found


def test_a_robot_that_goes_elsewhere_than_its_schedule_says_is_found(tmp_path: Path) -> None:
    recordings = scheduled(tmp_path)
    r3 = next(each for each in recordings if each.metadata.robot == "R3")
    ways = [each.data for each in r3.records if "travel_to" in each.data]
    names = ("activation", "global_task", "local_task", "travel_to")
    elsewhere = next(way for way in ways if way["travel_to"] != ways[0]["travel_to"])
    change = {name: elsewhere[name] for name in names}

    def goes_elsewhere(records: Records) -> Records:
        return other(records, ACTIONS, change, event="started", travel_to=ways[0]["travel_to"])

    others = [each for each in recordings if each is not r3]
    found = texts(verify([rewritten(r3, goes_elsewhere, tmp_path), *others]))
    assert "which its plan does not give it" in found, found
