"""The benchmark of proofs: what it measures is what robots do."""

from __future__ import annotations

import random

import pytest

from benchmarks import security
from benchmarks.flooder import spoilt
from mrbt_mesh.core.membership.envelope import MAX_TAGS, ForgedError, Guard
from mrbt_mesh.core.membership.wire import MessageKind


def test_the_keys_are_those_of_one_team() -> None:
    mine, theirs, *_ = security.team_keys(3)
    assert mine.members() == ("R000", "R001", "R002", "operator")
    sealed = Guard(mine, "run", 1).seal(b"x")
    assert Guard(theirs, "run", 1).open(sealed, MessageKind.HEARTBEAT, mine.name)[1] == b"x"


@pytest.mark.parametrize(("robots", "has_tags"), [(3, True), (MAX_TAGS + 1, False)])
def test_every_step_is_measured(robots: int, has_tags: bool) -> None:
    costs = security.message_costs(robots, 200)
    assert set(costs) == ({"seal", "gate", "open"} if has_tags else {"seal", "open"})
    assert all(0 < each["median_us"] <= each["p99_us"] for each in costs.values())


def test_what_the_flooder_says_is_never_quite_what_was_said() -> None:
    mine, theirs, *_ = security.team_keys(3)
    sealed, dice = Guard(mine, "run", 1).seal(b"x" * 350, (theirs.name,)), random.Random(1)
    refused = 0
    for _ in range(200):
        changed = spoilt(sealed, dice)
        assert len(changed) == len(sealed)
        try:
            Guard(theirs, "run", 1).open(changed, MessageKind.HEARTBEAT, mine.name)
        except ForgedError:
            refused += 1
        else:
            assert changed == sealed, "the same byte was changed and changed back"
    assert refused > 190
