"""Recordings as they were at an earlier time."""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.recording.reader import RecordedMessages, Recording


def until(recording: Recording, unix_us: int) -> Recording:
    """Return a recording as it was at that Unix time, by its own clock."""
    at_us = unix_us - recording.metadata.epoch_ns // 1_000
    later = (i for i, time_us in enumerate(recording.records.times_us) if time_us > at_us)
    end = next(later, len(recording.records))
    records = RecordedMessages.joined([(recording.records, 0)], end)
    if len(records) == len(recording.records):
        return recording
    number = records[-1].number if records else recording.metadata.after_number
    return replace(
        recording,
        records=records,
        cut_off_at=recording.cut_off_at or 0,
        signatures=tuple(each for each in recording.signatures if each.number <= number),
        is_finished=False,
        last=(number, bytes.fromhex(records.check_of(number))),
    )
