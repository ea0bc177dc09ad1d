"""summary.json: whether its observer has signed it, and against the recording of that observer."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, RecordingError
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.runtime.summary_signature import parse_signature
from mrbt_mesh.views.replay.findings import Gap, GapKind, RecordingFinding

FILE = "summary.json"


@dataclass(frozen=True)
class SummaryFile:
    """A run's summary.json as it is on disk, and its signature; empty: it is missing."""

    content: bytes
    signature: str


def check_summary(
    summary: SummaryFile, recordings: Sequence[Recording], manifest: Manifest | None
) -> tuple[list[RecordingFinding], list[Gap]]:
    """Where it differs from the one observer's recording, if that has the whole run; and whether it
    is signed, in a team with keys.
    """
    findings, gaps = [], []
    run = recordings[0].metadata.run
    if manifest is not None and not summary.signature:
        text = "it has no signature"
        gaps.append(Gap(GapKind.SUMMARY, FILE, text, "give summary.signature as it was written"))
    elif manifest is not None and not _is_signed(manifest, run, summary):
        text = "it is not what was signed in summary.signature"
        findings.append(RecordingFinding(FILE, 0, 0, text))
    observers = [each for each in recordings if not each.metadata.robot]
    if len(observers) == 1:
        for text in _differing(summary.content, observers[0]):
            findings.append(RecordingFinding(FILE, 0, 0, text, (observers[0].name,)))
    return findings, gaps


def _is_signed(manifest: Manifest, run: str, summary: SummaryFile) -> bool:
    try:
        return parse_signature(summary.signature).is_for(manifest, run, summary.content)
    except ValueError:
        return False


def _differing(content: bytes, recording: Recording) -> Iterator[str]:
    """What follows from the facts alone; the times of faults are signed."""
    try:
        player = Player(recording)
        player.seek(player.end_us)
    except RecordingError:
        return  # a finding of that recording
    recorded = player.summary()
    try:
        summary = json.loads(content)
        if player.observer.record.result is None:
            return  # the summary knows more: the journals of robots
        for name in ("mission", "result"):
            if summary[name] != recorded[name]:
                yield f"its {name} is {summary[name]}, that of the recording {recorded[name]}"
        tasks: Mapping[str, Any] = summary["global_tasks"]
        for task, row in recorded["global_tasks"].items():
            if tasks[task] != row:
                yield f"{task} is {tasks[task]}, in the recording {row}"
    except (ValueError, KeyError, TypeError) as error:
        yield f"it is malformed: {error!r}"
