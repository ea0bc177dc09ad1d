"""Whether all robots hold the same plan, and if not, who differs and since when."""

from __future__ import annotations

from collections import Counter
from typing import Any

from mrbt_mesh.core.observer.observer import Observer


def reported_plans(observer: Observer) -> dict[str, bytes]:
    """The digest of the plan of each robot in good standing, as it told last; empty: it has none.

    Sorted by robots.
    """
    return {
        robot: peer.report.plan_digest
        for robot, peer in sorted(observer.membership.peers.items())
        if peer.report.has_joined and peer.state.is_healthy
    }


class AgreementView:
    """Remembers since when each robot differs from most of the others."""

    def __init__(self) -> None:
        self._since_us: dict[str, int] = {}

    def look(self, observer: Observer, now_us: int) -> dict[str, Any]:
        """`equal`, how many `robots` report a plan, and `differ`: robot -> since when, in s."""
        digests = reported_plans(observer)
        counts = Counter(digests.values())
        own = observer.plan.digest if observer.plan is not None else b""
        usual = max(counts, key=lambda digest: (counts[digest], digest == own, digest), default=b"")
        differ = [robot for robot, digest in digests.items() if digest != usual]
        self._since_us = {robot: self._since_us.get(robot, now_us) for robot in differ}
        return {
            "equal": not differ,
            "robots": len(digests),
            "differ": {r: observer.record.seconds(at_us) for r, at_us in self._since_us.items()},
        }
