"""`mrbt status`."""

from __future__ import annotations

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.options import JsonOption
from mrbt_mesh.cli.team.options import TeamOptions


def status(team: TeamOptions, given: Given, as_json: JsonOption = False) -> None:
    """Tell who does what, what is blocked, and whether all agree.

    Example: mrbt status --json
    """
    from mrbt_mesh.cli.team.finished import summary_of_finished, tell_finished

    found = team.run_directory(given)
    summary = summary_of_finished(found) if found is not None else None
    if summary is not None:
        tell_finished(summary, as_json)
        return
    # Only now what listens to the network: Zenoh, and what plans.
    from mrbt_mesh.cli.team.status import tell_status

    tell_status(team.find(given), as_json)
