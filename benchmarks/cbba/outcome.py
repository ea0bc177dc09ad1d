"""What a decentralised auction came to, and what it took."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import msgpack
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Outcome:
    """`paths`: the tasks of each robot in the order of its path; `winners`: a robot or -1 per task.

    `rounds` counts those until all robots hold the same lists and nobody bids any more, as an
    onlooker sees it. The robots themselves would need some more to know.
    """

    paths: tuple[tuple[int, ...], ...]
    winners: tuple[int, ...]
    rounds: int
    messages: int
    bytes: int


class NotConvergedError(RuntimeError):
    """An auction did not come to an end."""


def message_bytes(lists: Iterable[NDArray[np.int64]]) -> int:
    """Length of a message with these lists in msgpack, the encoding that this project uses."""
    return len(msgpack.packb([each.tolist() for each in lists]))


def pick(gains: NDArray[np.int64], robot: int, spread: bool) -> int:
    """The task with the highest gain.

    Of equal ones the first, or with `spread` the robot's number picks one: robots that see the
    same ties then bid for different tasks, which saves rounds.
    """
    if not spread:
        return int(np.argmax(gains))
    equal = np.flatnonzero(gains == gains.max())
    return int(equal[robot % len(equal)])
