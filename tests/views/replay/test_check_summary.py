"""summary.json: signed by its observer, and as the observer's recording has it."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest

from mrbt_mesh.recording import channels
from mrbt_mesh.recording.metadata import NamedRecording
from mrbt_mesh.recording.reader import RecordedMessages, Recording, named
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.runtime.summary_signature import Covered, parse_signature, signature_of
from mrbt_mesh.sim import Kill
from mrbt_mesh.views.replay import check_team
from mrbt_mesh.views.replay.check_files import RunDirFiles
from mrbt_mesh.views.replay.check_summary import SummaryFile, check_summary, missing_summary
from mrbt_mesh.views.replay.findings import GapKind, Verification
from mrbt_mesh.views.replay.verify import verify
from tests.support.keys import keys_of
from tests.support.recorded import read_all, record_keyed

Run = tuple[list[Recording], Manifest, bytes]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("summary")
    result, manifest = record_keyed(folder, "explore", 3)
    return read_all(folder), manifest, json.dumps(result.summary).encode()


def found(run: Run, content: bytes, signature: str) -> list[str]:
    verdict = verify(*run[:2], RunDirFiles(SummaryFile(content, signature)))
    return [str(each) for each in (*verdict.findings, *verdict.gaps)]


def signed(run: Run, content: bytes, by: str = "eye") -> str:
    return covering(run, content, (), by)


def covering(
    run: Run, content: bytes, recordings: tuple[NamedRecording, ...], by: str = "eye"
) -> str:
    covered = Covered(run[0][0].metadata.run, "", recordings)
    return signature_of(keys_of("R1", "R2", observer="eye")[by], content, covered)


def test_a_signed_summary_is_proved(run: Run) -> None:
    content = run[2]
    assert found(run, content, signed(run, content)) == []


def test_what_is_not_signed_is_named(run: Run) -> None:
    content = run[2]
    (text,) = found(run, content.replace(b"duration_s", b"length_s"), signed(run, content))
    assert text == "summary.json: it is not what was signed in summary.signature"
    assert found(run, content, signed(run, content, "R1")) == [text]
    not_ours = "summary.signature: it is not as mrbt writes it"
    for signature in ("[]", "{}", signed(run, content).replace("\n", "\r\n")):
        assert found(run, content, signature) == [not_ours]
    assert "it has no signature" in found(run, content, "")[0]


def test_a_stolen_key_does_not_hide_another_result(run: Run) -> None:
    forged = run[2].replace(b'"result": "success"', b'"result": "failure"', 1)
    (text,) = found(run, forged, signed(run, forged))
    assert "its result is failure, that of the recording success" in text
    (text,) = found(run, b"{}", signed(run, b"{}"))
    assert "it is malformed" in text


def test_a_summary_of_an_earlier_end_is_named(run: Run) -> None:
    """With its honest signature, beside the recordings of the run that went on."""
    recordings, manifest, content = run
    *robots, observer = recordings
    at_end = named([each.path for each in recordings], observer.metadata.run)
    assert found(run, content, covering(run, content, at_end)) == []
    earlier = replace(observer.metadata, earlier=at_end[:1])
    later = [*robots, replace(observer, metadata=earlier)]
    signature = covering(run, content, at_end[:-1])
    verdict = verify(later, manifest, RunDirFiles(SummaryFile(content, signature)))
    (text,) = map(str, verdict.findings)
    assert text.startswith("summary.json: it is of an earlier end of the run")


def test_a_robot_that_joined_after_the_end_does_not_make_the_summary_an_old_one(run: Run) -> None:
    recordings, manifest, content = run
    robot = recordings[0]
    records, statuses = robot.records, robot.records.topics.index(channels.STATUSES)
    last = len(records) - 1 - [*reversed(records.topics)].index(channels.STATUSES)
    at_end = named([each.path for each in recordings], robot.metadata.run)
    summary = SummaryFile(content, covering(run, content, at_end[1:]))
    metadata = replace(robot.metadata, earlier=at_end[:1])
    for begin, accused in ((statuses, 1), (last, 0)):
        later = RecordedMessages.joined([(records, begin)])
        again = replace(robot, metadata=metadata, records=later)
        findings, gaps = check_summary(summary, [again, *recordings[1:]], manifest)
        assert (len(findings), gaps) == (accused, []), findings


def test_a_recording_that_the_summary_names_is_missed(run: Run) -> None:
    content = run[2]
    lost = NamedRecording("R1.2.mcap", 40, "0" * 32)
    (text,) = found(run, content, covering(run, content, (lost,)))
    assert text.startswith("R1.2.mcap: it is missing, and summary.json names it")


def test_a_deeply_nested_summary_is_malformed(run: Run) -> None:
    content = b"[" * 100_000
    assert any("malformed" in text for text in found(run, content, signed(run, content)))


def test_a_signed_summary_explains_an_abrupt_end(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """All that was known of a killed `mrbt up`, or of the last robot that was killed."""
    recordings, manifest, content = run
    at_end = named([each.path for each in recordings], recordings[0].metadata.run)
    for index, recording in ((-1, recordings[-1]), (0, recordings[0])):
        signatures = tuple(each for each in recording.signatures if not each.is_end)
        abrupt = replace(recording, signatures=signatures, cut_off_at=1)
        here = [*recordings]
        here[index] = abrupt

        def gaps(here: list[Recording], names: tuple[NamedRecording, ...] | None) -> list[str]:
            summary = None
            if names is not None:
                summary = SummaryFile(content, covering(run, content, names))
            files = RunDirFiles(summary, others=() if names else ("run.json",))
            return [str(gap) for gap in verify(here, manifest, files).gaps]

        assert gaps(here, at_end) == []
        goes_on = tuple(each._replace(is_finished=False) for each in at_end)
        (text,) = gaps(here, goes_on)
        assert re.match(rf"{recording.name}: it ends abruptly at [0-9.]+ s \(signed until ", text)
        assert text.endswith("if nothing more was recorded, accept it with --accept end")
        assert gaps(here, None) == [text]
    monkeypatch.setattr(check_team, "LEAVE_LIMIT_S", 0.0)
    monkeypatch.setattr(check_team, "CLOCKS_US", 0)
    observer = recordings[-1]
    earlier = replace(observer.metadata, epoch_ns=observer.metadata.epoch_ns - 1_000_000_000)
    signatures = tuple(each for each in observer.signatures if not each.is_end)
    cut = replace(observer, metadata=earlier, signatures=signatures, cut_off_at=1)
    verdict = verify(
        [*recordings[:-1], cut],
        manifest,
        RunDirFiles(SummaryFile(content, covering(run, content, at_end))),
    )
    assert any("run.mcap: it ends abruptly at" in str(gap) for gap in verdict.gaps)


def test_what_was_signed_afterwards_closes_nothing(run: Run) -> None:
    """A summary that `mrbt up` wrote may have been removed, and a recording changed, before."""
    recordings, manifest, content = run
    *robots, observer = recordings
    observer = replace(observer, metadata=replace(observer.metadata, has_summary=True))
    at_end = named([each.path for each in recordings], observer.metadata.run)
    key = keys_of("R1", "R2", observer="eye")["eye"]

    def verdict(here: list[Recording], at_s: int | None) -> Verification:
        covered = Covered(observer.metadata.run, "", at_end, at_s)
        text = signature_of(key, content, covered)
        assert parse_signature(text, observer.metadata.run).covered == covered
        return verify(here, manifest, RunDirFiles(SummaryFile(content, text)))

    whole = [*robots, observer]
    assert verdict(whole, None).is_proved
    later = verdict(whole, 1_000_000_000)
    (text,) = map(str, later.gaps)
    assert text.startswith("summary.json: the one written at the end of run.mcap is missing: this")
    assert text.endswith("or accept that with --accept summary")
    (note,) = (each for each in later.notes if "afterwards" in each)
    assert (
        "signed afterwards, at 2001-09-09 01:46:40 UTC by status: what was changed before" in note
    )
    signatures = tuple(each for each in observer.signatures if not each.is_end)
    killed = [*robots, replace(observer, signatures=signatures, cut_off_at=1)]
    assert verdict(killed, None).is_proved
    assert verdict(killed, 1).gaps == verify(killed, manifest, RunDirFiles()).gaps
    assert [gap.kind for gap in verdict(killed, 1).gaps] == [GapKind.END]


@pytest.mark.parametrize("at_s", ['"1"', "true", "-1", "1.5", "null", "1e300"])
def test_a_time_that_no_clock_shows_is_not_signed(run: Run, at_s: str) -> None:
    text = signed(run, run[2])[:-2] + f', "afterwards_unix_s": {at_s}}}\n'
    assert found(run, run[2], text) == ["summary.signature: it is not as mrbt writes it"]


def test_a_killed_robots_end_stays_open_until_the_runs_end_is_signed(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Others noticed its death; but anybody could have changed what it did not sign."""
    folder = tmp_path_factory.mktemp("killed")
    result, manifest = record_keyed(folder, "explore", 3, [(3_000_000, Kill("R1"))])
    recordings, content = read_all(folder), json.dumps(result.summary).encode()
    assert verify(recordings, manifest).is_proved
    (gap,) = verify(recordings, manifest, RunDirFiles()).gaps
    assert (gap.kind, gap.of) == (GapKind.END, "R1.mcap")
    assert "no summary.json that was signed at the run's end says how far it goes" in gap.text
    at_end = named([each.path for each in recordings], recordings[0].metadata.run)
    key = keys_of("R1", "R2", observer="eye")["eye"]
    text = signature_of(key, content, Covered(recordings[0].metadata.run, "", at_end))
    assert verify(recordings, manifest, RunDirFiles(SummaryFile(content, text))).is_proved


def test_the_summary_of_an_end_after_which_the_run_went_on_is_not_missed(run: Run) -> None:
    """`mrbt up --continue` has removed it."""
    *robots, observer = run[0]
    observer = replace(observer, metadata=replace(observer.metadata, has_summary=True))
    assert [gap.of for gap in missing_summary([*robots, observer])] == ["summary.json"]
    at_end = named([observer.path], observer.metadata.run)
    went_on = replace(observer.metadata, earlier=at_end)
    later = replace(
        observer, path=observer.path.with_name("run.2.mcap"), metadata=went_on, signatures=()
    )
    assert [*missing_summary([*robots, observer, later])] == []


def test_a_summary_whose_signature_alone_is_there_is_missing(run: Run) -> None:
    (text,) = found(run, b"", signed(run, run[2]))
    assert text.startswith("summary.json: it is missing, and summary.signature is here: give it")
