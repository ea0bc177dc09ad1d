"""The parts of an agent whose mission has tasks that coalitions carry out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mrbt_mesh.core.feature import Kit, Part
from mrbt_mesh.features.exclusive.coalition_begin import BeginWatch
from mrbt_mesh.features.exclusive.coalition_start import CoalitionStart
from mrbt_mesh.features.exclusive.fields import CoalitionFields
from mrbt_mesh.features.exclusive.leased_start import LeasedStart


def parts(
    kit: Kit, policies: Sequence[CoalitionFields], before: Sequence[Part], now_us: int
) -> Sequence[Part]:
    """The parts for tasks with these policies. What leases and beginnings an earlier mission has
    left goes on.
    """
    return tuple(_parts(kit, policies, {type(part): part for part in before}, now_us))


def _parts(
    kit: Kit,
    policies: Sequence[CoalitionFields],
    before: dict[type[Part], Part],
    now_us: int,
) -> Iterator[Part]:
    yield before.get(CoalitionStart) or CoalitionStart(kit.context)
    if LeasedStart in before:
        yield before[LeasedStart]
    elif any(policy.exclusive for policy in policies):
        yield LeasedStart(kit, now_us)
    if BeginWatch in before:
        yield before[BeginWatch]
    elif any(policy.simultaneous for policy in policies):
        yield BeginWatch(kit)
