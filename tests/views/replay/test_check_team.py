"""What is proved of a team with keys, what is not, and every kind of forgery."""

from __future__ import annotations

import random
import re
from dataclasses import replace
from pathlib import Path

import pytest

from mrbt_mesh.recording.earlier import until
from mrbt_mesh.runtime.member_keys import Manifest, MemberKeys
from mrbt_mesh.sim import Freeze, Kill, Restart, Schedule, Thaw
from mrbt_mesh.views.replay import check_team
from mrbt_mesh.views.replay.check_files import RunDirFiles
from mrbt_mesh.views.replay.findings import GapKind, Verification
from mrbt_mesh.views.replay.verify import verify
from tests.support.forger import FORGERIES, Cast, Run, written_again
from tests.support.keys import keys_of
from tests.support.recorded import read_all, record_keyed

ROBOTS = ("A1", "A2", "B1", "B2", "C1", "C2")
FAULTS: dict[str, Schedule] = {
    "none": (),
    "killed": ((12_500_000, Kill("A1")),),
    "restarted": ((4_000_000, Kill("A1")), (6_000_000, Restart("A1"))),
    "frozen": ((3_000_000, Freeze("B1")), (8_000_000, Thaw("B1"))),
}


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Manifest]:
    """The recordings of a run with keys in which A1 died, by the name of the file."""
    folder = tmp_path_factory.mktemp("keyed")
    _, manifest = record_keyed(folder, "vehicle_repair", 7, FAULTS["killed"])
    return {each.name: each for each in read_all(folder)}, manifest


def texts(verdict: Verification) -> str:
    return "\n".join(map(str, (*verdict.findings, *verdict.gaps)))


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_an_honest_run_is_proved(tmp_path: Path, fault: str) -> None:
    _, manifest = record_keyed(tmp_path, "vehicle_repair", 7, FAULTS[fault])
    recordings = read_all(tmp_path)
    verdict = verify(recordings, manifest)
    assert verdict.is_proved, texts(verdict)
    assert {each.file for each in verdict.proved} == {each.name for each in recordings}
    ends = {each.file: each.end for each in verdict.proved}
    assert ends["A2.mcap"] == "its end"
    if fault in ("killed", "restarted"):
        assert ends["A1.mcap"].startswith("no end: killed (")
        assert "run.mcap" in ends["A1.mcap"]


@pytest.mark.slow
@pytest.mark.parametrize("name", FORGERIES)
def test_a_forgery_without_keys_is_named(
    keyed: tuple[Run, Manifest], tmp_path: Path, name: str
) -> None:
    (run, manifest), forgery = keyed, FORGERIES[name]
    verdict = verify(written_again(forgery.forge(run, cast()), tmp_path, {}, run), manifest)
    assert not verdict.is_proved
    assert re.search(forgery.found, texts(verdict)), texts(verdict)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORGERIES)
def test_what_the_others_say_of_a_forgery_with_a_stolen_key(
    keyed: tuple[Run, Manifest], tmp_path: Path, name: str
) -> None:
    (run, manifest), forgery = keyed, FORGERIES[name]
    forged = written_again(forgery.forge(run, cast()), tmp_path, stolen(run), run)
    found = verify(forged, manifest)
    if forgery.by_others is None:
        assert found.is_proved, texts(found)
    else:
        assert re.search(forgery.by_others, texts(found)), texts(found)


def cast() -> Cast:
    """B1's recording is forged; A1 died."""
    return Cast("B1.mcap", "A1", "B2", random.Random(1))


def stolen(run: Run) -> dict[str, MemberKeys]:
    """All keys, by the file that they sign."""
    keys = keys_of(*ROBOTS, observer="eye")
    return {file: keys[each.metadata.robot or "eye"] for file, each in run.items()}


def test_without_its_manifest_nothing_is_proved(keyed: tuple[Run, Manifest]) -> None:
    verdict = verify(list(keyed[0].values()))
    assert [gap.kind for gap in verdict.gaps] == [GapKind.UNSIGNED]
    assert "give --keys" in texts(verdict)
    assert verdict.holds(["unsigned"])


def test_a_team_that_nobody_observed_lacks_no_observer(keyed: tuple[Run, Manifest]) -> None:
    robots = [each for each in keyed[0].values() if each.metadata.robot]
    alone = [replace(r, metadata=replace(r.metadata, is_observed=False)) for r in robots]
    assert [gap.kind for gap in verify(robots).gaps] == [GapKind.UNSIGNED, GapKind.OBSERVER]
    assert [gap.kind for gap in verify(alone).gaps] == [GapKind.UNSIGNED]


def test_another_teams_manifest_proves_nothing(keyed: tuple[Run, Manifest]) -> None:
    other = keys_of(*ROBOTS, observer="eye", team="other")["eye"].manifest
    assert "what was recorded before was not signed by B1" in texts(
        verify(list(keyed[0].values()), other)
    )


@pytest.mark.slow
def test_a_robot_that_joins_late_has_noticed_no_end_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All died at once, and A1, which hears nobody, waits before it joins again."""
    killed = [(4_000_000, Kill(robot)) for robot in ROBOTS]
    again = [(5_000_000 if robot == "A1" else 25_000_000, Restart(robot)) for robot in ROBOTS]
    _, manifest = record_keyed(tmp_path, "vehicle_repair", 7, (*killed, *again))
    robots = [each for each in read_all(tmp_path) if each.metadata.robot]
    alone = [replace(r, metadata=replace(r.metadata, is_observed=False)) for r in robots]
    # No delay at all is allowed from when a robot could notice to when it did.
    allowed_us = robots[0].metadata.timing.max_detection_us + check_team.SIGN_US
    monkeypatch.setattr(check_team, "CLOCKS_US", -allowed_us)
    verdict = verify(alone, manifest)
    assert verdict.is_proved, texts(verdict)


def test_an_end_that_others_had_no_time_to_notice_is_no_gap_of_a_running_team(
    keyed: tuple[Run, Manifest],
) -> None:
    """A1 died at 12.5 s; each recording as it was then, and a second before it."""
    run, manifest = keyed
    began = min(each.metadata.epoch_ns // 1_000 + each.begin_us for each in run.values())
    for at_us in (began + 12_510_000, began + 11_500_000):
        then = [until(each, at_us) for each in run.values()]
        (a1,) = (each for each in then if each.metadata.robot == "A1")
        dead = replace(a1, is_finished=True, cut_off_at=0)
        others = [each for each in then if each is not a1]
        at_work = verify([*others, dead], manifest, RunDirFiles(is_running=True))
        assert [str(gap) for gap in at_work.gaps if gap.kind is GapKind.END] == []
        ended = verify([*others, dead], manifest, RunDirFiles())
        assert {gap.of for gap in ended.gaps if gap.kind is GapKind.END} >= {"A2.mcap", "A1.mcap"}


def test_what_is_torn_behind_a_signed_end_is_said(keyed: tuple[Run, Manifest]) -> None:
    run, manifest = keyed
    torn = [replace(r, torn_bytes=7) if name == "B1.mcap" else r for name, r in run.items()]
    verdict = verify(torn, manifest)
    assert verdict.is_proved
    assert any(
        each.startswith("B1.mcap: behind its signed end its last 7") for each in verdict.notes
    )
