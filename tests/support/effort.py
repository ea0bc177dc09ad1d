"""How much the tests try: `MRBT_TESTS` is `quick` (the default), `gate` (`.ci/run`) or `long`.

Nothing else decides it. `MRBT_CHAOS_SEEDS` and `MRBT_EXAMPLES` replace one figure each.
"""

from __future__ import annotations

import os
from enum import StrEnum
from typing import TypeVar

T = TypeVar("T")


class Size(StrEnum):
    QUICK = "quick"
    GATE = "gate"
    LONG = "long"


SIZE = Size(os.environ.get("MRBT_TESTS") or Size.QUICK)


def at_size(*, quick: T, gate: T, long: T | None = None) -> T:
    """The value for the size of this run; `long` is `gate` unless given."""
    if SIZE is Size.QUICK:
        return quick
    return gate if SIZE is Size.GATE or long is None else long


def seeds(many: int) -> range:
    """The seeds of a test: all of them, or the first tenth in quick runs."""
    return range(at_size(quick=-(-many // 10), gate=many))


# Seeds of chaos on generated missions (tests/sim/test_chaos.py), in whole blocks.
CHAOS_BLOCK = 10
CHAOS_SEEDS = int(os.environ.get("MRBT_CHAOS_SEEDS") or at_size(quick=20, gate=100, long=1_000))
# Examples of each property that hypothesis tries, unless the test has a figure of its own.
EXAMPLES = int(os.environ.get("MRBT_EXAMPLES") or at_size(quick=10, gate=50, long=1_000))
