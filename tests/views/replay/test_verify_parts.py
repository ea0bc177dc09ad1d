"""A long recording has parts: each is verified alone, and all as far as they are kept."""

from __future__ import annotations

import json
import re
import shutil
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.recording.channels import PARTS, POSITIONS, SIGNATURES
from mrbt_mesh.recording.folder import (
    first_part,
    number_of_part,
    observer_file,
    robot_file,
    robot_files,
)
from mrbt_mesh.recording.messages import MessageEncoder
from mrbt_mesh.recording.metadata import OBSERVER
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import open_recording, read_recording, read_recordings
from mrbt_mesh.recording.writer import RecordingWriter
from mrbt_mesh.runtime.member_keys import Manifest, MemberKeys
from mrbt_mesh.runtime.summary_signature import Covered, signature_of
from mrbt_mesh.sim import AgentOptions, Freeze, Kill, Restart, Thaw
from mrbt_mesh.views.replay.check_files import RunDirFiles
from mrbt_mesh.views.replay.check_summary import SummaryFile
from mrbt_mesh.views.replay.findings import Verification
from mrbt_mesh.views.replay.verify import verify
from tests.support.keys import keys_of
from tests.support.recorded import read_all, record_example, state_text
from tests.support.runs import example

pytestmark = pytest.mark.timeout(600)

NAME, ROBOT = "vehicle_repair", "C1"
FAULTS = (
    (3_000_000, Freeze("B1")),
    (6_000_000, Thaw("B1")),
    (8_000_000, Kill("A1")),
    (11_000_000, Restart("A1")),
)
# With the first, nothing is removed.
WHOLE, LIMITED = 1_400_000, 560_000


@dataclass(frozen=True)
class Recorded:
    """One run: without a limit, with parts, and with the last parts alone."""

    unlimited: Path
    whole: Path
    limited: Path
    manifest: Manifest
    keys: dict[str, Keys]
    member_keys: MemberKeys


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    mission, _ = example(NAME)
    keys: dict[str, Keys] = dict(keys_of(*mission.robots, observer="eye"))
    eye = keys_of(*mission.robots, observer="eye")["eye"]
    keys[OBSERVER] = keys["eye"]
    folders = []
    for limit in (None, WHOLE, LIMITED):
        folder = tmp_path_factory.mktemp("parts")
        options = AgentOptions(keys=keys, record_limit_bytes=limit)
        record_example(folder, NAME, 7, FAULTS, options)
        folders.append(folder)
    return Recorded(*folders, eye.manifest, keys, eye)


def proved(verdict: Verification) -> Verification:
    assert not verdict.findings, "\n".join(map(str, verdict.findings[:10]))
    assert not verdict.gaps, "\n".join(map(str, verdict.gaps[:10]))
    return verdict


@pytest.mark.slow
def test_parts_together_are_the_whole_recording(run: Recorded) -> None:
    """The same states at all times, whether it has parts or not."""
    paths = {first_part(path) for path in robot_files(run.whole)}
    assert any(number_of_part(path) > 2 for path in robot_files(run.whole))
    for path in sorted(paths):
        plain = Player(open_recording(run.unlimited / path.relative_to(run.whole)))
        parts = Player(open_recording(path))
        length_us = plain.end_us - plain.begin_us
        for share in (0.2, 0.5, 0.8, 1):
            for player in (plain, parts):
                player.seek(plain.begin_us + round(share * length_us))
            assert state_text(parts.state.to_json()) == state_text(plain.state.to_json()), path
        assert parts.summary() == plain.summary()


def test_all_parts_are_proved(run: Recorded) -> None:
    assert proved(verify(read_all(run.whole), run.manifest)).notes == ()


def test_all_parts_are_for_their_owner_alone(run: Recorded) -> None:
    files = robot_files(run.whole)
    assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}


def test_what_is_not_kept_is_mentioned_and_no_accusation(run: Recorded) -> None:
    robots = [path for path in robot_files(run.limited) if path.stem.startswith(ROBOT)]
    assert number_of_part(robots[0]) > 1
    verdict = proved(verify(read_all(run.limited), run.manifest))
    assert any("begins with part" in note for note in verdict.notes)


def test_what_parts_that_are_not_kept_had_does_not_contradict_the_summary(run: Recorded) -> None:
    """Who took part in a task, and what came of one that is out of reach, is known only there."""
    whole = Player(open_recording(observer_file(run.unlimited)))
    whole.seek(whole.end_us)
    summary, recordings = whole.summary(), read_all(run.limited)
    (observer,) = (each for each in recordings if not each.metadata.robot)
    late = read_recording(observer.parts[-1].path)
    recordings = [*(each for each in recordings if each.metadata.robot), late]
    kept = Player(late)
    kept.seek(kept.end_us)
    assert kept.summary()["global_tasks"] != summary["global_tasks"]

    def verified(told: dict[str, Any]) -> Verification:
        content = json.dumps(told).encode()
        covered = Covered(late.metadata.run, "", ())
        signature = signature_of(run.member_keys, content, covered)
        files = RunDirFiles(SummaryFile(content, signature))
        return verify(recordings, run.manifest, files)

    verdict = verified(summary)
    assert not verdict.findings
    assert any(note.startswith("summary.json: not checked: who took") for note in verdict.notes)
    tasks = summary["global_tasks"]
    task = next(name for name, row in kept.summary()["global_tasks"].items() if row["robots"])
    (finding,) = verified(
        {**summary, "global_tasks": {**tasks, task: {**tasks[task], "robots": []}}}
    ).findings
    assert f"{task} is" in finding.text
    (finding,) = verified({**summary, "result": "failure"}).findings
    assert "its result is failure" in finding.text


def test_each_part_is_read_and_proved_alone(run: Recorded) -> None:
    for path in robot_files(run.whole):
        if number_of_part(path) > 1:
            recording = read_recording(path)
            assert recording.metadata.part == number_of_part(path)
            player = Player(recording)
            player.seek(player.end_us)
            assert player.observer.plan is not None
            verdict = verify([recording], run.manifest)
            assert not verdict.findings, (path, list(map(str, verdict.findings[:3])))


def test_a_part_that_is_missing_in_the_middle_or_at_the_begin_is_a_gap(
    run: Recorded, tmp_path: Path
) -> None:
    for number in (1, 2):
        folder = tmp_path / str(number)
        shutil.copytree(run.whole, folder)
        path = robot_file(folder, ROBOT)
        (path if number == 1 else path.with_name(f"{ROBOT}.part2.mcap")).unlink()
        verdict = verify(read_all(folder), run.manifest)
        assert not verdict.findings, list(map(str, verdict.findings[:3]))
        assert any(ROBOT in gap.of for gap in verdict.gaps), number
    assert len(read_recordings(robot_file(tmp_path / "2", ROBOT))) == 2


def test_the_last_part_removed_is_missed(run: Recorded, tmp_path: Path) -> None:
    shutil.copytree(run.whole, tmp_path / "run")
    parts = [p for p in robot_files(tmp_path / "run") if first_part(p).stem == ROBOT]
    parts[-1].unlink()
    verdict = verify(read_all(tmp_path / "run"), run.manifest)
    assert any(ROBOT in str(each) for each in (*verdict.gaps, *verdict.findings))


def test_another_state_at_the_beginning_of_a_part_is_named(run: Recorded, tmp_path: Path) -> None:
    """By one who has the robot's key, and signs it again."""
    shutil.copytree(run.whole, tmp_path / "run")
    path = next(p for p in robot_files(tmp_path / "run") if p.name == f"{ROBOT}.part2.mcap")
    recording = read_recording(path)
    state = recording.records.topics.index(PARTS)
    path.unlink()
    encoder = MessageEncoder(recording.metadata)
    writer = RecordingWriter(path, recording.metadata)
    for index, record in enumerate(recording.records):
        data = dict(record.data)
        if index < state and record.topic == POSITIONS:
            continue
        if record.topic == SIGNATURES:
            data = encoder.sign(run.keys[ROBOT], data["end"], record.at_us)
        writer.write(record.topic, record.at_us, data)
        encoder.encode(record.topic, record.at_us, data)
    writer.close()
    verdict = verify(read_all(tmp_path / "run"), run.manifest)
    texts = [str(each) for each in (*verdict.findings, *verdict.gaps)]
    assert any(re.search(rf"{ROBOT}\.(part2\.)?mcap", text) for text in texts), texts
