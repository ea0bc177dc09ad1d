"""What the robots of a run began and ended, by their own recordings.

The runtime records each start, end and stop of a local task, whatever its program does;
events.jsonl, written by the program, does not prove what the program left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mrbt_mesh.core.facts.records import MEMBER, Member
from mrbt_mesh.core.mission.names import split_call
from mrbt_mesh.recording.channels import ACTIONS, FACTS
from mrbt_mesh.recording.folder import first_parts, robot_files
from mrbt_mesh.recording.messages import unpack_fact
from mrbt_mesh.recording.reader import Recording, RecordingError, read_recordings


def read_work(run_dir: Path) -> tuple[list[dict[str, Any]], set[str]]:
    """Return the starts and ends in the form of events.jsonl, by time.

    Also returns the robots that have recorded something.
    """
    found: list[dict[str, Any]] = []
    robots = set()
    for path in first_parts(robot_files(run_dir)):
        try:
            for recording in read_recordings(path, checks_schemas=False):
                found += _work(recording)
                robots |= {recording.metadata.robot} if recording.records else set()
        except RecordingError:
            continue  # its robot counts as one that has recorded nothing
    return sorted(found, key=lambda each: float(each["t"])), robots


def _work(recording: Recording) -> Iterator[dict[str, Any]]:
    epoch_s, robot = recording.metadata.epoch_ns / 1e9, recording.metadata.robot
    pid = 0
    for record in recording.records.of(FACTS, ACTIONS):
        data = record.data
        if record.topic == FACTS:
            if (data["author"], data["name"]) == (robot, MEMBER):
                member = unpack_fact(data).record
                pid = member.pid if isinstance(member, Member) else pid
            continue
        event, at_s = data["event"], epoch_s + record.at_us / 1e6
        local_task, arguments = split_call(data["local_task"])
        row = {
            "t": at_s,
            "robot": robot,
            "pid": pid,
            "incarnation": f"{recording.name}/{data['ticket']}",
            "activation": data["activation"],
            "global_task": data["global_task"],
            "local_task": local_task,
            "args": list(arguments),
            "outcome": None,
        }
        if event == "started":
            yield row | {"event": "start"} | ({"place": ""} if "travel_to" in data else {})
        elif event == "finished":
            yield row | {"event": "end", "outcome": "success" if data["success"] else "failure"}
        elif event == "stopped":
            yield row | {"event": "cancel"}
