"""What may be ordered by keys is carried out as the page's orders are."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("textual", reason="pip install 'mrbt-mesh[top]'")

from mrbt_mesh.drills.control import FAULTS, ORDERS, Control, OrderError
from mrbt_mesh.views.terminal.viewer import orders_of


class Refusing(Control):
    """Carries out orders to robots and refuses those to the team."""

    def __init__(self) -> None:
        self.given: list[Any] = []

    def offers(self) -> dict[str, Any]:
        """As with processes of this machine."""
        return {
            "robot": {name: text for name, (_, text) in FAULTS.items()},
            "team": {name: text for name, (_, text) in ORDERS.items()},
        }

    async def carry_out(self, order: Any) -> str:
        """Write it down."""
        if "robot" not in order:
            raise OrderError("no robot answers")
        self.given.append(order)
        return "done"


async def test_what_is_refused_is_told_and_ends_nothing() -> None:
    control = Refusing()
    orders = orders_of(control)
    assert list(orders.keys()) == list("kftpra")
    assert await orders.carry_out({"act": "kill", "robot": "A"}) == (True, "done")
    assert await orders.carry_out({"act": "pause"}) == (False, "no robot answers")
    assert control.given == [{"act": "kill", "robot": "A"}]
