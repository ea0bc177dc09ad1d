"""Which seeds `mrbt sim chaos` runs, as it is told."""

from __future__ import annotations

import re
from collections.abc import Sequence

from mrbt_mesh.errors import InputError

USUAL = range(100)


def parse_seeds(text: str | None, is_endless: bool) -> Sequence[int]:
    """`0:1000` (the last one left out), `7`, or `3,9,12`; None: the usual ones.

    With `is_endless` the seeds go on from the first, which is then all that may be given.
    Raises InputError.
    """
    if text is None:
        return USUAL
    match = re.fullmatch(r"(\d+):(\d+)|\d+(?:,\d+)*", text, re.ASCII)
    if match is None or (match[1] and int(match[1]) >= int(match[2])):
        raise InputError(f"--seeds {text}: expected FIRST:END, e.g. 0:1000, or seeds, e.g. 3,9")
    seeds: Sequence[int] = (
        range(int(match[1]), int(match[2])) if match[1] else [*map(int, text.split(","))]
    )
    if not match[1] and len(set(seeds)) < len(seeds):
        raise InputError(f"--seeds {text}: a seed is named twice")
    if is_endless and (match[1] or len(seeds) > 1):
        raise InputError(f"--seeds {text}: with --minutes only the first seed, e.g. {seeds[0]}")
    return seeds
