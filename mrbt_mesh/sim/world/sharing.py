"""Simulated robots of one process read each batch of facts and make each plan once for all.

They hand heartbeats over without encoding them. Not for runs that check whether robots come to the
same plan independently.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeVar

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.engine import Engine
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.wire import Header, Heartbeat
from mrbt_mesh.core.planning.make_plan import PlanFunction
from mrbt_mesh.core.planning.plan import Plan

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
    """A heartbeat between robots of one process, neither encoded nor decoded."""

    sender: str
    beat: Heartbeat


def shared_engine(mine: Header, engine: Engine) -> Engine:
    """An engine for all robots of one run, which keeps its recent answers."""

    def hand_over(beat: Heartbeat, mine: Header) -> bytes:
        message = HandedOver()
        message.sender, message.beat = mine.sender, beat
        return message

    def take_over(
        source: str, data: bytes, mine: Header, is_news: Callable[[list[Any]], bool]
    ) -> Heartbeat:
        if isinstance(data, HandedOver) and data.sender == source:
            return data.beat
        return engine.read_heartbeat(source, data, mine, is_news)

    @lru_cache(maxsize=RECENT)
    def batch_of(source: str, data: bytes) -> tuple[list[Entry], int]:
        return engine.read_batch(source, data, mine)

    plans: Recent[tuple[bytes, frozenset[tuple[str, Incarnation]]], Plan] = Recent()

    def shared_planning(solver: Solver) -> PlanFunction:
        make_plan = engine.plan_making(solver)

        def shared_plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
            key = (facts.map.digest(), frozenset(alive.items()))
            plan = plans.get(key)
            if plan is None:
                plan = plans[key] = make_plan(facts, alive)
            return plan

        return shared_plan

    return replace(
        engine,
        plan_making=shared_planning,
        write_heartbeat=hand_over,
        read_heartbeat=take_over,
        read_batch=lambda source, data, _: batch_of(source, data),
    )
