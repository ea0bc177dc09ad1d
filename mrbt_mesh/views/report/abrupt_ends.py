"""Robots whose recordings end abruptly, in a run of which no summary tells the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mrbt_mesh.recording.folder import is_finished
from mrbt_mesh.recording.reader import Recording
from mrbt_mesh.views.report.model import NOT_KNOWN, RunReport

_OVER = ("success", "failure", "not_started")
_GONE = ("dead", "left")


def with_abrupt_ends(found: RunReport, observed: Recording, last: Sequence[Recording]) -> RunReport:
    """Return the report without claims about what came after the ends of recordings.

    `observed`: the reported recording. `last`: the last recording of each robot.
    """
    if found.result in _OVER:
        return found
    abrupt = {each.metadata.robot for each in last if _ends_abruptly(each)}
    robots = tuple(
        replace(each, state=NOT_KNOWN) if each.robot in abrupt and each.state not in _GONE else each
        for each in found.robots
    )
    names = [each.robot for each in robots if each.state == NOT_KNOWN]
    is_open = not _ends_abruptly(observed) and len(names) < len(robots)
    if not names and is_open:
        return found
    notes = found.notes
    if names:
        text = "end abruptly, and no signed summary.json tells how it ended for them"
        notes = (*notes, f"the recordings of {', '.join(names)} {text}")
    return replace(found, result=found.result if is_open else NOT_KNOWN, robots=robots, notes=notes)


def _ends_abruptly(recording: Recording) -> bool:
    """Return whether nobody writes it any more, and it has no end."""
    is_ended = recording.cut_off_at is None or any(each.is_end for each in recording.signatures)
    path = recording.parts[-1].path if recording.parts else recording.path
    return not is_ended and is_finished(path)
