"""The timeline of a run from which older entries were dropped, for readers early and late."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.observer.work_log import WorkEnd
from mrbt_mesh.views.model.changes import ChangeLog
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.model.timeline import TimelineView
from mrbt_mesh.views.terminal.team import ShownTeam
from tests.support.watched import WELD, watched

LIMIT = 80


def goes_on(record: RunRecord, first: int, count: int) -> None:
    """Robot Z does one work after the other, and each is an event."""
    for number in range(first, first + count):
        claim = Claim(f"r:{number}:weld::0", "weld", "weld", Phase.RUNNING, 1)
        record.work_log.claimed("Z", claim, number * 10)
        record.say(number * 10, f"event {number}")


def test_readers_early_and_late_come_to_know_the_same() -> None:
    _, observer = watched(WELD)
    observer.record = record = RunRecord(observer.mission, LIMIT)
    record.started_us = 0
    claim = Claim("r:0:weld::0", "weld", "weld", Phase.RUNNING, 1)
    record.work_log.claimed("Y", claim, 1)
    view, log = TimelineView(observer), ChangeLog()
    early, asleep = ShownTeam(TeamView(observer)), ShownTeam(TeamView(observer))
    heard, slept = 0, 0
    for step in range(200):
        goes_on(record, 1 + step * 7, 7)
        view.put(log)
        early.take(log.since(heard))
        heard = log.version
        if step == 2:
            asleep.take(log.since(0))
            slept = heard
    asleep.take(log.since(slept))
    late = ShownTeam(TeamView(observer))
    late.take(items := log.since(0))
    assert len(items) <= 2 * LIMIT + 1, "what is dropped is dropped here too"
    for each in (early, asleep, late):
        each.now_s = 1e9
    assert known(early) == known(asleep) == known(late)
    assert late.older_events + len(late.events) == 1_400
    assert late.events[-1]["text"] == "event 1400"
    (at_work,) = late.works("Y", 0.0)
    assert at_work["ended_s"] is None, "however long ago it began"
    assert late.works("Z", 0.0)[0]["end"] == WorkEnd.DROPPED


def known(shown: ShownTeam) -> tuple[list[Any], ...]:
    return shown.events, shown.works("Z", -1.0), shown.works("Y", -1.0)
