"""Checks summary.json: its observer's signature, and that observer's recording."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.recording.folder import first_part
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, RecordingError
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.runtime.run_dir import SIGNATURE_FILE
from mrbt_mesh.runtime.summary_signature import Covered, parse_signature
from mrbt_mesh.views.replay.check_named import check_named, not_covered
from mrbt_mesh.views.replay.findings import Gap, GapKind, RecordingFinding

FILE = "summary.json"
_GIVE = f"give it, with {SIGNATURE_FILE}, or accept that with --accept {GapKind.SUMMARY}"


@dataclass(frozen=True)
class SummaryFile:
    """A run's summary.json as it is on disk, and its signature; empty: it is missing."""

    content: bytes
    signature: str


def check_summary(
    summary: SummaryFile, recordings: Sequence[Recording], manifest: Manifest | None
) -> tuple[list[RecordingFinding], list[Gap]]:
    """Return differences from the only observer's recording, if that has the whole run, and gaps.

    In a team with keys, the signature is checked as well.
    """
    findings: list[RecordingFinding] = []
    gaps: list[Gap] = []
    if not summary.content:
        gaps.append(
            Gap(GapKind.SUMMARY, FILE, f"it is missing, and {SIGNATURE_FILE} is here", _GIVE)
        )
        return findings, gaps
    if manifest is not None and not summary.signature:
        text = "it has no signature"
        gaps.append(Gap(GapKind.SUMMARY, FILE, text, "give summary.signature as it was written"))
    elif manifest is not None:
        for each in _signed(summary, recordings, manifest):
            if isinstance(each, Gap):
                gaps.append(each)
            else:
                findings.append(each)
    observers = [each for each in recordings if not each.metadata.robot]
    if len(observers) == 1:
        for text in _differing(summary.content, observers[0]):
            findings.append(RecordingFinding(FILE, 0, 0, text, (observers[0].name,)))
    return findings, gaps


def covered_by(summary: SummaryFile, run: str, manifest: Manifest) -> Covered | None:
    """Return what was signed together with the summary; None if it is not what was signed."""
    try:
        found = parse_signature(summary.signature, run)
    except ValueError:
        return None
    return found.covered if found.is_for(manifest, summary.content) else None


def not_checked(summary: SummaryFile, recordings: Sequence[Recording]) -> Iterator[str]:
    """Yield notes on what the recordings no longer show of the summary."""
    observers = [each for each in recordings if not each.metadata.robot]
    late = [each.name for each in observers if each.begins_late]
    if summary.content and late:
        text = "who took part in tasks, and results of tasks, that only the parts not kept of"
        yield f"{FILE}: not checked: {text} {', '.join(late)} had"


def missing_summary(recordings: Sequence[Recording], is_later: bool = False) -> Iterator[Gap]:
    """Report a missing summary: it must exist if its observer has come to its end.

    When a run goes on, the summary of its earlier end is removed. `is_later`: another one was
    signed afterwards.
    """
    went_on = {
        named.name for r in recordings if not r.metadata.robot for named in r.metadata.earlier
    }
    for each in recordings:
        has_ended = any(signed.is_end for signed in each.signatures)
        is_last = first_part(each.path).name not in went_on
        if each.metadata.has_summary and has_ended and is_last:
            text = f"the one written at the end of {each.name} is missing"
            if is_later:
                text += ": this one was signed afterwards"
            yield Gap(GapKind.SUMMARY, FILE, text, _GIVE)


def _signed(
    summary: SummaryFile, recordings: Sequence[Recording], manifest: Manifest
) -> Iterator[Gap | RecordingFinding]:
    """Check that it is what was signed, at the end of the newest recordings and with all named
    ones.
    """
    run = recordings[0].metadata.run
    try:
        parse_signature(summary.signature, run)
    except ValueError as error:
        yield RecordingFinding(SIGNATURE_FILE, 0, 0, str(error))
        return
    covered = covered_by(summary, run, manifest)
    if covered is None:
        text = "it is not what was signed in summary.signature"
        yield RecordingFinding(FILE, 0, 0, text)
        return
    if not covered.is_of_the_end:
        yield from missing_summary(recordings, is_later=True)
    yield from check_named(FILE, covered.recordings, recordings)
    for each in not_covered(covered, recordings):
        text = "it is of an earlier end of the run: it was signed before this recording began"
        yield RecordingFinding(FILE, 0, 0, text, (each.name,))


def _differing(content: bytes, recording: Recording) -> Iterator[str]:
    """Yield differences in what follows from the facts alone; the times of faults are signed."""
    try:
        player = Player(recording)
        player.seek(player.end_us)
    except RecordingError:
        return  # reported as a finding of that recording
    recorded = player.summary()
    try:
        summary = json.loads(content)
        if player.observer.record.result is None:
            return  # the summary knows more: the journals of robots
        for name in ("mission", "result"):
            if summary[name] != recorded[name]:
                yield f"its {name} is {summary[name]}, that of the recording {recorded[name]}"
        tasks: Mapping[str, Any] = summary["global_tasks"]
        known = _known_of_tasks(recorded["global_tasks"], tasks, player)
        for task, row in recorded["global_tasks"].items():
            if any(tasks[task][name] != each for name, each in known[task].items()):
                yield f"{task} is {tasks[task]}, in the recording {row}"
    except (ValueError, KeyError, TypeError, RecursionError):
        yield "it is malformed: it has not all that a run's summary has"


def _known_of_tasks(
    recorded: Mapping[str, Any], told: Mapping[str, Any], player: Player
) -> dict[str, dict[str, Any]]:
    """Return by task what its row in the summary must have, as far as the recording shows it.

    If its first parts were not kept, it shows only some of the robots that took part, and a result
    only where the last plan still has one.
    """
    if not player.recording.begins_late:
        return {task: dict(row) for task, row in recorded.items()}
    plan = player.observer.plan
    nodes = plan.evaluation.tree.actions() if plan is not None else ()
    over = (Status.SUCCESS, Status.FAILURE)
    shown = {
        node.subject for node in nodes if plan and plan.evaluation.status_of(node.index) in over
    }
    return {
        task: {
            "robots": sorted({*row["robots"], *told[task]["robots"]}),
            **({"status": row["status"]} if task in shown else {}),
        }
        for task, row in recorded.items()
    }
