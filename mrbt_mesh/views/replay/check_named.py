"""Checks that recordings named by other files of a run exist, as far as they were written then.

A recording names those that existed when it began, and summary.json those of the whole run. So no
part of a continued run can be removed, or replaced by an older one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mrbt_mesh.recording import channels
from mrbt_mesh.recording.folder import (
    FOLDER,
    OBSERVERS,
    first_part,
    numbered,
    observer_file,
    parts_of,
)
from mrbt_mesh.recording.metadata import NamedRecording
from mrbt_mesh.recording.reader import Recording
from mrbt_mesh.runtime.summary_signature import Covered
from mrbt_mesh.views.replay.findings import Gap, GapKind, RecordingFinding

_REMEDY = "give all recordings of the run"


def check_named(
    by: str, named: Sequence[NamedRecording], recordings: Sequence[Recording]
) -> Iterator[Gap | RecordingFinding]:
    """Yield differences from what the file `by` names: a gap if missing, a change if different."""
    for each in named:
        here = [r for r in recordings if first_part(r.path).name == each.name]
        if has_it := [recording for recording in recordings if _has(recording, each)]:
            yield from _renamed(by, each, has_it)
            yield from _added(by, each, [*has_it, *here])
        elif not here:
            yield Gap(GapKind.NAMED, each.name, f"it is missing, and {by} names it", _REMEDY)
        elif all(each.number > recording.last[0] for recording in here):
            text = f"it ends at record {here[-1].last[0]}, and {by} names its record {each.number}"
            yield Gap(GapKind.NAMED, each.name, text, "give the whole file")
        else:
            text = "what was recorded until here is not what was there before"
            yield RecordingFinding(each.name, each.number, 0, text, (by,))


def _renamed(
    by: str, named: NamedRecording, recordings: Sequence[Recording]
) -> Iterator[RecordingFinding]:
    """Yield a recording of a run directory that has another name than when it was written."""
    if all(first_part(each.path).name != named.name for each in recordings):
        for each in recordings:
            # A robot that was not launched by `mrbt up` records where it was told.
            is_launched = each.metadata.is_observed and each.path.parent.name == FOLDER
            if is_launched or is_observers_of_run(each):
                text = f"it is the recording that {by} calls {named.name}"
                yield RecordingFinding(each.name, 0, 0, text, (by,))


def is_observers_of_run(recording: Recording) -> bool:
    """Return whether it is an observer's recording in a run directory, under whatever number."""
    path = recording.path
    is_named_so = path.name.startswith(f"{OBSERVERS}.") and (path.parent / FOLDER).is_dir()
    return is_named_so and not recording.metadata.robot


def misnamed(recording: Recording) -> str:
    """Return why an observer's recording of a run directory had another name when it was written;
    else an empty text.

    It took the first name that was free, and names the recordings that had the others.
    """
    path, taken = first_part(recording.path), [each.name for each in recording.metadata.earlier]
    if path.name in taken:
        return f"it is not {path.name}: it names that one as an earlier recording"
    free = next(
        each
        for each in numbered(observer_file(path.parent))
        if each == path or (each.name not in taken and not parts_of(each))
    )
    return f"it was written with another name: {free.name} was free" if free != path else ""


def _added(
    by: str, named: NamedRecording, recordings: Sequence[Recording]
) -> Iterator[RecordingFinding]:
    """Yield what stands behind the last record of a finished recording."""
    end = max(recordings, key=lambda each: each.last[0])
    if named.is_finished and end.last[0] > named.number:
        text = f"what follows was added: record {named.number} was the last when {by} was written"
        yield RecordingFinding(end.name_at(named.number + 1), named.number + 1, 0, text, (by,))


def finished_by(recording: Recording, finished: Sequence[tuple[str, NamedRecording]]) -> str:
    """Return the file that says that this recording was finished with its last record, or an empty
    text.
    """
    number, check = recording.last
    ends = (by for by, each in finished if (each.number, each.check) == (number, check.hex()))
    return next(ends, "")


def not_covered(covered: Covered, recordings: Sequence[Recording]) -> Iterator[Recording]:
    """Yield the recordings that continue others and did not exist when a summary was signed.

    A robot that was restarted after the mission's end adds nothing to what has ended.
    """
    for recording in recordings:
        is_named = any(_has(recording, each) for each in covered.recordings)
        if recording.metadata.earlier and not is_named and not _began_at_the_end(recording):
            yield recording


def _began_at_the_end(recording: Recording) -> bool:
    """Return whether it is of a robot for which the mission was over from the beginning."""
    topics = recording.records.topics
    if not recording.metadata.robot or channels.STATUSES not in topics:
        return False
    first = recording.records[topics.index(channels.STATUSES)]
    return first.data.get("T_G") in ("success", "failure")


def _has(recording: Recording, named: NamedRecording) -> bool:
    """Return whether it has what is named, or had it in a part that was not kept."""
    is_kept = recording.metadata.part == 1 or named.number > recording.metadata.after_number
    if is_kept:
        return recording.has(named.number, named.check)
    return first_part(recording.path).name == named.name
