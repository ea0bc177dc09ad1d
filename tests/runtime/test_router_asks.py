"""Questions to routers are asked together."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from mrbt_mesh.core.agent.effects import AskRouter
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.runtime.router_asks import RouterAsks


def ask(robot: str) -> AskRouter:
    return AskRouter(robot, Incarnation(1, "n"), "r1")


async def test_what_comes_in_one_turn_of_the_loop_is_one_question() -> None:
    asked: list[list[str]] = []

    def note(effects: Sequence[AskRouter]) -> None:
        asked.append([effect.robot for effect in effects])

    asks = RouterAsks(note)
    asks.add(ask("A1"))
    asks.add(ask("B1"))
    assert asked == [], "others may follow"
    await asyncio.sleep(0)
    assert asked == [["A1", "B1"]]
    asks.add(ask("C1"))
    await asyncio.sleep(0)
    assert asked == [["A1", "B1"], ["C1"]]
