"""Recorded runs in virtual time, for tests."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.recording.channels import BEATS, CHANNELS, ROBOTS
from mrbt_mesh.recording.folder import first_parts, observer_files, robot_files
from mrbt_mesh.recording.mcap_file import channel_numbers, message
from mrbt_mesh.recording.messages import next_check, to_json
from mrbt_mesh.recording.metadata import OBSERVER
from mrbt_mesh.recording.reader import Recording, read_recordings
from mrbt_mesh.runtime.member_keys import Manifest, MemberKeys
from mrbt_mesh.sim import AgentOptions, Schedule, SimulationResult, simulate
from mrbt_mesh.sim.run import run_scenario
from tests.support.keys import keys_of
from tests.support.runs import example, source


def record_example(
    folder: Path,
    name: str,
    seed: int,
    schedule: Schedule = (),
    options: AgentOptions | None = None,
    timeout_us: int = 60 * SECOND_US,
) -> SimulationResult:
    """Simulate an example, and record it in a folder."""
    mission, program = example(name)
    return simulate(
        mission,
        program,
        seed=seed,
        schedule=list(schedule),
        agents=options or AgentOptions(),
        record=folder,
        timeout_us=timeout_us,
    )


def record_keyed(
    folder: Path, name: str, seed: int, schedule: Schedule = ()
) -> tuple[SimulationResult, Manifest]:
    """Simulate an example whose robots have keys, and record it; its observer is `eye`."""
    mission, _ = example(name)
    keys = keys_of(*mission.robots, observer="eye")
    options = AgentOptions(keys={**keys, OBSERVER: keys["eye"]})
    return record_example(folder, name, seed, schedule, options), keys["eye"].manifest


def record_chaos(folder: Path, seed: int) -> tuple[dict[str, MemberKeys], Manifest]:
    """A generated mission's team with keys, and random faults: `mrbt sim chaos --generated`; its
    keys by robot, and that of the observer.
    """
    mission, program = source(None).load(seed)
    keys = keys_of(*mission.robots, observer="eye")
    keys = {**keys, OBSERVER: keys["eye"]}
    scenario = source(None).scenario(seed, mission)
    run_scenario(mission, program, scenario, record=folder, keys=keys)
    return keys, keys["eye"].manifest


def read_all(folder: Path) -> list[Recording]:
    """The recordings of one run: its robots', then the observer's."""
    files = [*first_parts(robot_files(folder)), *first_parts(observer_files(folder))]
    return [each for path in files for each in read_recordings(path)]


def state_text(state: Mapping[str, Any]) -> str:
    """The same state is the same text."""
    return json.dumps(state, sort_keys=True, indent=2)


def with_one_more(recording: Recording) -> bytes:
    """A killed robot's recording, with what it said last of another one again behind its end.

    Anybody can compute the check, and what is behind the last signature is not signed.
    """
    assert recording.cut_off_at is not None
    last = [*recording.records.of(ROBOTS)][-1]
    at_ns = recording.metadata.epoch_ns + recording.records[-1].at_us * 1_000
    number, body = recording.last[0] + 1, to_json(last.data).encode()
    check = next_check(recording.last[1], number, ROBOTS, at_ns, body).hex()
    channel = channel_numbers(topic for topic in CHANNELS if topic != BEATS)[ROBOTS]
    text = body[:-1] + f',"check":"{check}"}}'.encode()
    whole = recording.path.read_bytes()[: recording.cut_off_at]
    return whole + message(channel, number, at_ns, text)
