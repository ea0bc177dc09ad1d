"""`mrbt decide`."""

from __future__ import annotations

from typing import Annotated, Literal

from mrbt_mesh.cli.framework.declare import Given, argument
from mrbt_mesh.cli.team.options import TeamOptions


def decide(
    global_task: Annotated[str, argument("GLOBAL_TASK", "An exclusive task that is in doubt.")],
    decision: Annotated[
        Literal["done", "failed", "retry"], argument("DECISION", "What became of it.")
    ],
    team: TeamOptions,
    given: Given,
) -> None:
    """Say how an exclusive task goes on whose robot vanished in the middle of it.

    `done` and `failed` say how it ended; `retry` has it done again from the beginning.

    Example: mrbt decide "dose(2)" done
    """
    from mrbt_mesh.cli.team.orders import tell
    from mrbt_mesh.core.agent.commands import DECIDE

    tell(team.find(given), None, DECIDE, f"{global_task} {decision}")
