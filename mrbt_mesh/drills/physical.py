"""The physical truth of a run: what the robots recorded in events.jsonl, as intervals.

A robot's program writes one line for each start of a local task and one for its end or its
cancellation; the runtime itself writes none (see agents/simulated.py).
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

INFINITY = float("inf")
# How long a thawed robot may continue what it gives up: the rest of its current step.
YIELDS_WITHIN_S = 1.0
_EXECUTION = ("robot", "pid", "incarnation", "activation", "local_task")


@dataclass(frozen=True)
class Span:
    """One execution of a local task; `end` is `success`, `failure`, `cancel`, or None: it died.

    `part` has the arguments as one text. Times are in s since 1970.
    """

    robot: str
    pid: int
    incarnation: str
    global_task: str
    local_task: str
    part: str
    activation: str
    start_s: float
    end_s: float
    end: str | None

    @property
    def ground(self) -> str:
        """The local task with its arguments, as in the mission."""
        return f"{self.local_task}({self.part})" if self.part else self.local_task

    def overlaps(self, other: Span) -> bool:
        return self.start_s < other.end_s and other.start_s < self.end_s


def read_events(path: Path) -> list[dict[str, Any]]:
    """Return the events so far, complete lines only: one may be half written on a full disk."""
    found = []
    try:
        for line in path.read_text(encoding="utf-8").splitlines():
            with contextlib.suppress(ValueError):
                found.append(json.loads(line))
    except OSError:
        pass
    return found


def spans(
    events: Iterable[Mapping[str, Any]], deaths: Mapping[int, float] | None = None
) -> list[Span]:
    """Return all executions in the order of their starts.

    The way to a place is not included. An execution that never ended ends with its process, by
    `deaths` (pid -> when), else at infinity. Raises ValueError for a record that no robot writes:
    one execution started twice, or ended without a start.
    """
    found: list[Span] = []
    open_events: dict[tuple[Any, ...], Mapping[str, Any]] = {}

    def close(event: Mapping[str, Any], end_s: float, end: str | None) -> None:
        if "place" in event:
            return  # it was on its way, and did not begin
        found.append(
            Span(
                event["robot"],
                event["pid"],
                event["incarnation"],
                event["global_task"],
                event["local_task"],
                ",".join(event["args"]),
                event["activation"],
                event["t"],
                end_s,
                end,
            )
        )

    for event in events:
        key = tuple(event[name] for name in _EXECUTION)
        if event["event"] == "start":
            if key in open_events:
                raise ValueError(f"started twice: {event}")
            open_events[key] = event
        elif event["event"] == "begin" and key in open_events:
            open_events[key] = event
        elif key not in open_events:
            raise ValueError(f"ended without a start: {event}")
        else:
            close(open_events.pop(key), event["t"], event["outcome"] or event["event"])
    for event in open_events.values():
        close(event, (deaths or {}).get(event["pid"], INFINITY), None)
    return sorted(found, key=lambda span: (span.start_s, span.robot))


def of(found: Iterable[Span], local_task: str, part: str | None = None) -> list[Span]:
    """Return the executions of one local task, for one part or for all."""
    return [s for s in found if s.local_task == local_task and part in (None, s.part)]


def most_at_once(found: Iterable[Span]) -> int:
    """Return the maximum number of these that ran at the same time."""
    listed = list(found)
    return max((sum(s.start_s <= t.start_s < s.end_s for s in listed) for t in listed), default=0)


@dataclass(frozen=True)
class FreezeSpan:
    """A period in which a process was frozen, from SIGSTOP to SIGCONT (or the end: infinity)."""

    pid: int
    from_s: float
    to_s: float = INFINITY


def moving(span: Span, freezes: Iterable[FreezeSpan]) -> list[Span]:
    """Return the parts of an execution in which its process was not frozen.

    What a thawed robot gave up at once counts only up to the freeze.
    """
    parts = [span]
    for freeze in freezes:
        if freeze.pid != span.pid:
            continue
        last = parts[-1]
        if not last.start_s < freeze.from_s < last.end_s:
            continue
        parts[-1] = replace(last, end_s=freeze.from_s)
        gave_up = span.end == "cancel" and last.end_s <= freeze.to_s + YIELDS_WITHIN_S
        if freeze.to_s < last.end_s and not gave_up:
            parts.append(replace(last, start_s=freeze.to_s))
    return parts
