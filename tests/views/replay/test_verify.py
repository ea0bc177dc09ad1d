"""Recordings of good runs are proved, whatever befell them; falsified ones are found and named."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from mrbt_mesh.recording.channels import ACTIONS, FACTS, LIFE, PLANS
from mrbt_mesh.recording.reader import RecordedMessage, Recording, RecordingError, parse_recording
from mrbt_mesh.sim import Freeze, Kill, Leave, Lose, Schedule, Thaw
from mrbt_mesh.sim.run import run_scenario
from mrbt_mesh.views.replay.findings import Verification
from mrbt_mesh.views.replay.verify import verify
from tests.support.effort import IS_LONG
from tests.support.falsify import falsify, write_again
from tests.support.recorded import read_all, record_example
from tests.support.runs import source

pytestmark = pytest.mark.timeout(900)

# With MRBT_LONG=1 so many; a part of them otherwise.
CHAOS_SEEDS, SOME_CHAOS_SEEDS = 200, 8
FALSIFICATIONS, SOME_FALSIFICATIONS = 200, 20
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
    assert verdict.is_good, where + "\n" + "\n".join(map(str, verdict.findings[:10]))
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


def test_plans_that_were_made_apart_are_proved(tmp_path: Path) -> None:
    record_example(tmp_path, "vehicle_repair", 4, FAULTS["death"], plan_delay_us=20_000)
    proved(read_all(tmp_path))


@pytest.mark.parametrize("part", range(4))
def test_no_false_alarm_in_chaos(tmp_path: Path, part: int) -> None:
    for number in range(part, CHAOS_SEEDS if IS_LONG else SOME_CHAOS_SEEDS, 4):
        mission, program = source(None).load(number)
        folder = tmp_path / str(number)
        run_scenario(mission, program, source(None).scenario(number, mission), record=folder)
        proved(read_all(folder), f"mrbt sim chaos --generated --seeds {number}")


def test_a_robot_that_catches_up_has_given_up_what_its_plan_still_says(tmp_path: Path) -> None:
    mission, program = source(None).load(82)
    run_scenario(mission, program, source(None).scenario(82, mission), record=tmp_path)
    recordings = read_all(tmp_path)
    told = {r.data["event"] for each in recordings for r in each.records if r.topic == LIFE}
    assert {"catches_up", "caught_up"} <= told
    proved(recordings)


def test_random_falsifications_are_all_found_and_named(
    repaired: list[Recording], tmp_path: Path
) -> None:
    proved(repaired)
    tried, wanted = 0, FALSIFICATIONS if IS_LONG else SOME_FALSIFICATIONS
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


def changed(
    recording: Recording, folder: Path, change: Callable[[RecordedMessage], RecordedMessage]
) -> Recording:
    """The recording with other records, as an able forger would write it."""
    path = folder / recording.name
    write_again(replace(recording, records=tuple(map(change, recording.records))), path)
    return parse_recording(path.read_bytes(), path)


def only(
    recording: Recording, topic: str, fits: Callable[[RecordedMessage], bool]
) -> RecordedMessage:
    return next(each for each in recording.records if each.topic == topic and fits(each))


def texts(verdict: Verification) -> str:
    return "\n".join(map(str, verdict.findings))


def test_a_robot_that_starts_what_its_plan_gives_to_another(
    repaired: list[Recording], tmp_path: Path
) -> None:
    b1 = next(each for each in repaired if each.metadata.robot == "B1")
    start = only(b1, ACTIONS, lambda each: each.data["event"] == "started")

    def other(record: RecordedMessage) -> RecordedMessage:
        data = {**record.data, "local_task": "do_diagnosis(1)"}
        return replace(record, data=data) if record is start else record

    verdict = verify([changed(b1, tmp_path, other), *[r for r in repaired if r is not b1]])
    assert "B1 starts do_diagnosis(1)" in texts(verdict)
    assert {each.record for each in verdict.findings} == {start.number}


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


def test_a_plan_that_leaves_a_robot_idle(repaired: list[Recording], tmp_path: Path) -> None:
    b1 = next(each for each in repaired if each.metadata.robot == "B1")
    plan = only(b1, PLANS, lambda each: "B1" in each.data["lines"])

    def without(record: RecordedMessage) -> RecordedMessage:
        lines = {k: v for k, v in record.data.get("lines", {}).items() if k != "B1"}
        return replace(record, data={**record.data, "lines": lines}) if record is plan else record

    verdict = verify([changed(b1, tmp_path, without), *[r for r in repaired if r is not b1]])
    assert (
        f"B1.mcap: record {plan.number}: the plan does not follow from its facts: other lines"
        in (texts(verdict))
    )


def test_a_fact_that_its_author_never_said_is_contradicted(
    repaired: list[Recording], tmp_path: Path
) -> None:
    """Facts and plans of one recording alone fit together; the author's own does not fit them."""
    a2, rest = repaired[1], [each for each in repaired if each is not repaired[1]]
    verdict = verify([parse_recording(a2.path.read_bytes(), a2.path), *rest])
    assert verdict.is_good
    last = [each for each in a2.records if each.topic == FACTS][-1]
    without = replace(a2, records=tuple(each for each in a2.records if each is not last))
    others = [each for each in rest if each.metadata.robot != "A2"]
    told = verify([without, *others])
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
    assert verdict.notes[0].startswith("A1.mcap: ends without its end")


def test_recordings_of_different_runs_are_refused(
    repaired: list[Recording], tmp_path: Path
) -> None:
    record_example(tmp_path, "explore", 1)
    with pytest.raises(RecordingError, match="are of different runs"):
        verify([repaired[0], *read_all(tmp_path)])
