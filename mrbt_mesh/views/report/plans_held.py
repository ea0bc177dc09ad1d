"""Which plans robots reported, and when each of them and all of them did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mrbt_mesh.views.report.model import ReportedPlan

DIGEST_BYTES = 4


@dataclass
class _Held:
    """A plan while robots report it. `since_us`: robot -> when it did first."""

    digest: bytes
    from_us: int
    since_us: dict[str, int] = field(default_factory=dict)
    all_us: int | None = None
    to_us: int | None = None


class PlansHeld:
    """Call `look` whenever something may have changed, and `end` once."""

    def __init__(self) -> None:
        self._all: list[_Held] = []
        # By digest, as long as a robot reports it: a team may return to an earlier plan.
        self._open: dict[bytes, _Held] = {}

    def look(self, digests: Mapping[str, bytes], now_us: int) -> None:
        """Robots in good standing report these; no digest: it has no plan."""
        reported = set(digests.values())
        for digest in [each for each in self._open if each not in reported]:
            self._open.pop(digest).to_us = now_us
        for robot, digest in sorted(digests.items()):
            if not digest:
                continue
            if digest not in self._open:
                self._open[digest] = _Held(digest, now_us)
                self._all.append(self._open[digest])
            self._open[digest].since_us.setdefault(robot, now_us)
        if len(reported) == 1 and (held := self._open.get(min(reported))) is not None:
            held.all_us = now_us if held.all_us is None else held.all_us

    def end(self, now_us: int) -> None:
        """The run is over: what they report, they report until now."""
        self.look({}, now_us)

    def plans(self, start_us: int) -> tuple[ReportedPlan, ...]:
        """In the order in which they came up."""
        return tuple(
            ReportedPlan(
                number,
                held.digest[:DIGEST_BYTES].hex(),
                (held.from_us - start_us) / 1e6,
                None if held.all_us is None else (held.all_us - start_us) / 1e6,
                ((held.from_us if held.to_us is None else held.to_us) - start_us) / 1e6,
                {robot: (at_us - start_us) / 1e6 for robot, at_us in held.since_us.items()},
            )
            for number, held in enumerate(self._all, start=1)
        )
