"""`mrbt groot2`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import JsonOption
from mrbt_mesh.cli.team.options import TeamOptions


def groot2(
    *,
    robot: Annotated[
        str | None, option("The tree of this robot, T_i, in place of the team's.", "ID")
    ] = None,
    port: Annotated[int, option("Port for Groot2; 0: any.", "PORT", least=0, most=65_535)] = 1667,
    host: Annotated[str, option("Listen on this address; 0.0.0.0: on all.", "IP")] = "127.0.0.1",
    as_json: JsonOption = False,
    team: TeamOptions,
    given: Given,
) -> None:
    """Show a team's tree live in Groot2, or in any other monitor of BehaviorTree.CPP.

    It listens until it is stopped, also after the mission: Ctrl-C. The team does not notice it.
    Conditions are entries of the blackboards. There are no breakpoints (docs/groot2.md).

    Example: mrbt up MISSION --detach; mrbt groot2
    """
    import anyio

    from mrbt_mesh.adapters.node_statuses import observed_tree
    from mrbt_mesh.cli.framework.exits import end_process
    from mrbt_mesh.cli.team.monitoring import monitor

    address = team.find(given)
    tree = observed_tree(address.mission, robot)
    end_process(anyio.run(monitor, address, tree, host, port, as_json))
