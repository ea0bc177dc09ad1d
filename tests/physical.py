"""Reading the physical truth: what robots recorded themselves, as intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Span:
    """One execution of a local task; `end` is `success`, `failure`, `cancel`, or None: it died."""

    robot: str
    incarnation: str
    global_task: str
    local_task: str
    part: str
    activation: str
    start_s: float
    end_s: float
    end: str | None

    @property
    def type(self) -> str:
        return self.robot[0]

    def overlaps(self, other: Span) -> bool:
        return self.start_s < other.end_s and other.start_s < self.end_s


def spans(events: Iterable[Mapping[str, Any]]) -> list[Span]:
    """All executions in the order of their starts; one that never ended ends at infinity."""
    found: list[Span] = []
    open_spans: dict[tuple[Any, ...], Mapping[str, Any]] = {}

    def close(event: Mapping[str, Any], end_s: float, end: str | None) -> None:
        found.append(
            Span(
                event["robot"],
                event["incarnation"],
                event["global_task"],
                event["local_task"],
                "".join(event["args"]),
                event["activation"],
                event["t"],
                end_s,
                end,
            )
        )

    for event in events:
        key = (event["robot"], event["pid"], event["incarnation"], event["activation"])
        key = (*key, event["local_task"])
        if event["event"] == "start":
            assert key not in open_spans, f"started twice: {event}"
            open_spans[key] = event
        else:
            close(open_spans.pop(key), event["t"], event["outcome"] or event["event"])
    for event in open_spans.values():
        close(event, float("inf"), None)
    return sorted(found, key=lambda span: (span.start_s, span.robot))


def of(found: Iterable[Span], local_task: str, part: str | None = None) -> list[Span]:
    """The executions of one local task, for one part or for all."""
    return [s for s in found if s.local_task == local_task and part in (None, s.part)]


def most_at_once(found: Iterable[Span]) -> int:
    """How many of these ran at the same time."""
    listed = list(found)
    return max((sum(s.start_s <= t.start_s < s.end_s for s in listed) for t in listed), default=0)
