"""Recordings of real robots: nothing that one has said is lost with it, and all of it is proved."""

from __future__ import annotations

import json
import signal

import anyio
import psutil
import pytest

from mrbt_mesh.recording.channels import BEATS
from mrbt_mesh.recording.folder import observer_file, robot_file, robot_files
from mrbt_mesh.recording.messages import unpack_fact
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, named, read_recording
from mrbt_mesh.recording.recorded_state import team_state
from mrbt_mesh.runtime.journal import read_journals
from mrbt_mesh.runtime.observer_recording import RecordTo
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team_address import address_of
from mrbt_mesh.runtime.watcher import watching
from tests.support.recorded import state_text, with_one_more
from tests.support.team import EXPLORE, Team


def at_the_end(recording: Recording) -> Player:
    player = Player(recording)
    player.seek(player.end_us)
    return player


def facts_by(recording: Recording, author: str) -> set[int]:
    """The hashes of all facts of one author in a recording."""
    entries = [unpack_fact(each.data) for each in recording.records if each.topic == "/facts"]
    return {entry.hash for entry in entries if entry.author == author}


def test_a_killed_robot_has_recorded_all_that_others_heard_of_it(team: Team) -> None:
    team.hold("replace_hw")
    team.up()
    team.wait_for_event("replace_hw", "start")
    team.mrbt("kill", "A1", "--run-dir", str(team.run_dir))
    team.wait_for_line("A1 is dead")
    team.release()
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success"), team.logs()
    killed = read_recording(robot_file(team.run_dir, "A1"))
    assert killed.cut_off_at is not None
    assert killed.damage == ()
    own = facts_by(killed, "A1")
    assert own
    for path in robot_files(team.run_dir):
        assert facts_by(read_recording(path), "A1") <= own, path
    told = json.loads(team.mrbt("recording", "verify", str(team.run_dir), "--json"))
    assert told["verified"]
    assert len(told["files"]) == 7
    assert told["counts"]["signatures"] == told["counts"]["facts"]
    (proved,) = [each for each in told["proved"] if each["file"] == "A1.mcap"]
    assert proved["end"].startswith("no end: killed (A2.mcap, ")
    info = RunDir(team.run_dir).info()
    robots = [robot for robot in info.robots if robot != "A1"]
    mission = killed.metadata.mission_digest
    journals = read_journals(team.run_dir, robots, mission, info.run)
    for robot in robots:
        facts = at_the_end(read_recording(robot_file(team.run_dir, robot))).state.facts.map
        kept = {(e.author, e.name, e.version, e.packed) for e in journals[robot]}
        assert {(e.author, e.name, e.version, e.packed) for e in facts} == kept, robot


def test_nothing_can_be_added_to_a_killed_robots_recording_once_the_run_has_ended(
    team: Team,
) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_event("explore", "start")
    team.mrbt("kill", "R1", "--run-dir", str(team.run_dir))
    team.wait_for_line("R1 is dead")
    team.release()
    team.end()
    signed = json.loads((team.run_dir / "summary.signature").read_text())
    assert [(name, *rest) for name, _, _, *rest in signed["recordings"]] == [
        ("R1.mcap", True),
        ("R2.mcap", True),
        ("run.mcap", True),
    ]
    path = robot_file(team.run_dir, "R1")
    path.write_bytes(with_one_more(read_recording(path)))
    done = team.command("recording", "verify", str(team.run_dir), "--json")
    findings = json.loads(done.stdout)["findings"]
    assert len(findings) == 1, findings
    (finding,) = findings
    assert (finding["file"], finding["against"]) == ("R1.mcap", ["summary.json"])
    assert done.returncode == 1


@pytest.mark.parametrize("who", ["mrbt up", "all robots"])
def test_the_end_of_a_run_is_proved_by_who_has_seen_it(team: Team, who: str) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    recorded, run = [observer_file(team.run_dir)], RunDir(team.run_dir).info().run
    team.wait_until(lambda: any(each.number for each in named(recorded, run)), "it is recorded")
    processes = team.running()
    if who == "mrbt up":
        team.signal_launcher(signal.SIGKILL)
        psutil.wait_procs(processes)
        done = team.command("recording", "verify", str(team.run_dir), "--json")
        gaps = json.loads(done.stdout)["not_proved"]
        (gap,) = gaps
        assert (gap["kind"], gap["of"], done.returncode) == ("end", "run.mcap", 1)
        assert "its observer ended before it wrote summary.json" in gap["text"]
        assert gap["remedy"].endswith("--accept end")
        team.mrbt("status", "--run-dir", str(team.run_dir))
        done = team.command("recording", "verify", str(team.run_dir), "--json")
        told = json.loads(done.stdout)
        assert (told["not_proved"], done.returncode) == (gaps, 1)
        assert any("signed afterwards, at " in note for note in told["notes"])
        team.mrbt("recording", "verify", str(team.run_dir), "--accept", "end")
        return
    for process in processes:
        process.kill()
    team.end()
    told = json.loads(team.mrbt("recording", "verify", str(team.run_dir), "--json"))
    ends = [each["end"] for each in told["proved"]]
    assert "no end: ended abruptly (nobody wrote it any more when summary.json was written)" in ends


def test_of_a_running_team_what_is_signed_so_far_is_proved(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_events(2, "explore")
    recorded = [observer_file(team.run_dir), *robot_files(team.run_dir)]
    run = RunDir(team.run_dir).info().run
    team.wait_until(lambda: all(n.number > 1 for n in named(recorded, run)), "all is recorded")
    told = json.loads(team.command("recording", "verify", str(team.run_dir), "--json").stdout)
    assert told["running"]
    assert [gap for gap in told["not_proved"] if gap["kind"] == "end"] == []
    assert told["findings"] == []
    assert {each["end"] for each in told["proved"]} == {"it is still written"}
    printed = team.command("recording", "verify", str(team.run_dir)).stdout
    assert printed.startswith("the team runs: ")
    team.release()
    team.end()
    told = json.loads(team.mrbt("recording", "verify", str(team.run_dir), "--json"))
    assert not told["running"]


def test_with_a_refused_key_no_command_is_carried_out(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_event("explore", "start")
    key = team.run_dir / "keys" / "operator.key"
    key.chmod(0o644)
    alive = {process.pid for process in team.running()}
    for words in (("kill", "R1"), ("freeze", "R1"), ("down",), ("join", "R1", "--takeover")):
        done = team.command(*words, "--run-dir", str(team.run_dir))
        assert (done.returncode, "chmod 600" in done.stderr) == (2, True), done
    assert {process.pid for process in team.running()} == alive
    assert not (team.run_dir / "commands.jsonl").exists()
    key.chmod(0o600)
    team.mrbt("down", "--run-dir", str(team.run_dir))


def test_one_who_watches_records_the_state_that_it_holds(team: Team) -> None:
    team.hold("explore")
    team.up(EXPLORE, "--no-record")
    team.wait_for_event("explore", "start")
    assert not robot_files(team.run_dir)
    assert not observer_file(team.run_dir).exists()
    file = team.folder / "watched.mcap"

    async def watch() -> tuple[str, str]:
        to = RecordTo(file, beats=True)
        async with watching(address_of(RunDir(team.run_dir)), to) as watcher:
            while not (watcher.observer.caught_up and watcher.observer.claim("R1")):
                await watcher.wait_for_change(0.1)
            team.release()
            while watcher.observer.record.result is None:
                await watcher.wait_for_change(0.1)
            live = watcher.observer
            assert live.plan is not None
            alive = live.membership.members()
            return state_text(team_state(live.facts, alive, None)), live.plan.digest.hex()

    text, digest = anyio.run(watch)
    team.end()
    recording = read_recording(file)
    state = at_the_end(recording).state
    assert recording.cut_off_at is None
    assert state_text(team_state(state.facts, state.alive, None)) == text
    assert state.plan is not None
    assert state.plan["digest"] == digest
    beats = {each.data["source"] for each in recording.records if each.topic == BEATS}
    assert beats == {"R1", "R2"}
