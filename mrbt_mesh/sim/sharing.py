"""Robots that are simulated in one process read each batch of facts, and make each plan, once.
Their beats they hand each other as they are.

Not for runs that check whether robots come to the same plan independently.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, TypeVar

from mrbt_mesh.core.assignment import Solver
from mrbt_mesh.core.evaluate import Evaluator
from mrbt_mesh.core.facts import Entry, Incarnation
from mrbt_mesh.core.functions import (
    Functions,
    MakePlan,
    plan_making,
    read_batch,
    read_beat,
)
from mrbt_mesh.core.plan import Plan
from mrbt_mesh.core.team import TeamFacts
from mrbt_mesh.core.wire import Beat, Header

# Batches and plans are shared among robots at about the same time.
RECENT = 1_024


_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


class Recent(dict[_Key, _Value]):
    """A dictionary that is emptied when it has grown too large."""

    def __setitem__(self, key: _Key, value: _Value) -> None:
        if len(self) >= RECENT:
            self.clear()
        super().__setitem__(key, value)


class HandedOver(bytes):
    """A beat on its way between robots of one process: it needs neither writing nor reading."""

    sender: str
    beat: Beat


def shared_functions(mine: Header) -> Functions:
    """Functions for all robots of one run, which remember what they have answered lately."""

    def hand_over(beat: Beat, mine: Header) -> bytes:
        message = HandedOver()
        message.sender, message.beat = mine.sender, beat
        return message

    def take_over(
        source: str, data: bytes, mine: Header, is_news: Callable[[list[Any]], bool]
    ) -> Beat:
        if isinstance(data, HandedOver) and data.sender == source:
            return data.beat
        return read_beat(source, data, mine, is_news)

    @lru_cache(maxsize=RECENT)
    def batch_of(source: str, data: bytes) -> tuple[list[Entry], int]:
        return read_batch(source, data, mine)

    def shared_batch(source: str, data: bytes, mine: Header) -> tuple[list[Entry], int]:
        return batch_of(source, data)

    plans: Recent[tuple[bytes, frozenset[tuple[str, Incarnation]]], Plan] = Recent()

    def shared_planning(evaluator: Evaluator, solver: Solver) -> MakePlan:
        make_plan = plan_making(evaluator, solver)

        def shared_plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
            key = (facts.map.digest(), frozenset(alive.items()))
            plan = plans.get(key)
            if plan is None:
                plan = plans[key] = make_plan(facts, alive)
            return plan

        return shared_plan

    return Functions(shared_planning, hand_over, take_over, shared_batch)
