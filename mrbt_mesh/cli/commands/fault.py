"""`mrbt fault`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import RobotArgument
from mrbt_mesh.cli.team.options import TeamOptions
from mrbt_mesh.errors import InputError


def fault(
    *,
    robot: RobotArgument,
    lose: Annotated[
        str | None, option("Local task that the robot can no longer do, or `all`.", "LOCAL_TASK")
    ] = None,
    performance: Annotated[
        str | None, option("How well it does a local task from now on.", "LOCAL_TASK=X")
    ] = None,
    team: TeamOptions,
    given: Given,
) -> None:
    """Make a robot lose a capability, or do something better or worse.

    To lose one is a minor fault, as is a performance of 0: if the robot is working on it, that is
    cancelled, and the plan gives it to another. Any other performance counts for what comes next.

    Example: mrbt fault A1 --lose replace_hw

    Example: mrbt fault A1 --performance replace_hw=0.5
    """
    from mrbt_mesh.cli.team.orders import tell
    from mrbt_mesh.core.agent.commands import FAULT, PERFORM

    if lose is not None and performance is not None:
        raise InputError("--lose and --performance: give one of them")
    if lose is not None:
        tell(team.find(given), robot, FAULT, lose)
    if performance is None:
        raise InputError("what has become of the robot? Give --lose or --performance")
    tell(team.find(given), robot, PERFORM, performance)
