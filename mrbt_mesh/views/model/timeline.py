"""The timeline of a run: work, faults and events. A late page gets everything that is kept."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from mrbt_mesh.observer.episodes import MajorFault, MinorFault, after_text
from mrbt_mesh.observer.headline import wanted_activations
from mrbt_mesh.observer.newest import Newest
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.work_log import WorkSpan
from mrbt_mesh.views.model.changes import ChangeLog


class TimelineView:
    """Puts `work/N`, `fault/N`, `loss/N`, `event/N` and `unwatched/N` of a run into a log.

    Times are in seconds from the start of the run; `_ms` count from the fault, and `_after` are the
    same in words. `has_ended`: the robot's process is known to have ended. `wanted`: nobody has
    taken its work over, and the tree still requests it. `older` of an item: it is from before the
    run was watched, so its begin is not known. `unwatched`: a period of which nothing is known;
    `from_s` None: everything before.

    `older` as an item: for `work` and `event`, a number and which items below it are kept. Readers
    drop the others, which are not put as None.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._record = observer.record
        # What is in the log, by kind and number, and the work that may still change.
        self._shown: dict[str, set[int]] = {"work": set(), "event": set()}
        self._open_work: list[int] = []
        self._works = self._events = 0

    def put(self, log: ChangeLog) -> None:
        """Bring the log up to date."""
        spans = self._record.work_log.spans
        fresh = [number for number, _ in spans.since(self._works)]
        self._works, still_open = spans.total, []
        self._shown["work"].update(fresh)
        for number in (*self._open_work, *fresh):
            span = spans.get(number)
            if span is not None:
                log.put(f"work/{number}", self._work(span))
                # Its result may arrive after its end.
                if not self._record.work_log.is_settled(span):
                    still_open.append(number)
        self._open_work = still_open
        wanted = wanted_activations(self._observer) if self._record.major else set()
        for index, fault in enumerate(self._record.major):
            log.put(f"fault/{index}", self._major(fault, wanted))
        for index, loss in enumerate(self._record.minor):
            log.put(f"loss/{index}", self._minor(loss))
        for index, (from_us, to_us) in enumerate(self._record.unwatched):
            seconds = self._record.seconds
            log.put(f"unwatched/{index}", {"from_s": seconds(from_us), "to_s": seconds(to_us)})
        events = self._record.timeline
        for number, (at_us, text) in events.since(self._events):
            log.put(f"event/{number}", {"at_s": self._record.seconds(at_us), "text": text})
            self._shown["event"].add(number)
        self._events = events.total
        if spans.first or events.first:
            kinds: dict[str, Newest[Any]] = {"work": spans, "event": events}
            older = {k: [each.first, each.kept_before_first] for k, each in kinds.items()}
            if log.put("older", older):
                for kind, kept in kinds.items():
                    self._drop(log, kind, kept)

    def _drop(self, log: ChangeLog, kind: str, kept: Newest[Any]) -> None:
        gone = self._shown[kind].difference(number for number, _ in kept.since(0))
        self._shown[kind] -= gone
        for number in gone:
            log.drop(f"{kind}/{number}")

    def _work(self, span: WorkSpan) -> dict[str, Any]:
        seconds = self._record.seconds
        return {
            "robot": span.robot,
            "global_task": span.global_task,
            "local_task": span.local_task,
            "claimed_s": seconds(span.claimed_us),
            "running_s": seconds(span.running_us),
            "ended_s": seconds(span.ended_us),
            "end": None if span.end is None else str(span.end),
            "older": span.is_older,
            "reason": span.reason,
        }

    def _major(self, fault: MajorFault, wanted: Collection[str]) -> dict[str, Any]:
        seconds = self._record.seconds
        return {
            "robot": fault.robot,
            "at_s": seconds(fault.at_us),
            "until_s": seconds(fault.until_us),
            "has_ended": fault.exact,
            **_after("detected", fault.detected_after_us, fault.exact),
            **_after("taken_over", fault.reassigned_after_us, fault.exact),
            "held": fault.held.local_task if fault.held else None,
            "global_task": fault.held.global_task if fault.held else None,
            "replacement": fault.replacement,
            "wanted": bool(
                fault.held and not fault.replacement and fault.held.activation in wanted
            ),
            "older": fault.is_older,
        }

    def _minor(self, fault: MinorFault) -> dict[str, Any]:
        return {
            "robot": fault.robot,
            "local_tasks": list(fault.local_tasks),
            "reason": fault.reason,
            "at_s": self._record.seconds(fault.at_us),
            "until_s": self._record.seconds(fault.until_us),
        }


def _after(what: str, after_us: int | None, exact: bool) -> dict[str, Any]:
    if after_us is None:
        return {f"{what}_ms": None, f"{what}_after": None}
    return {f"{what}_ms": after_us / 1e3, f"{what}_after": after_text(after_us, exact)}
