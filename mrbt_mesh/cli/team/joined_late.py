"""What whoever comes late to a team is told first."""

from __future__ import annotations

from collections.abc import Callable

from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.runtime.past import tell_past
from mrbt_mesh.runtime.team import Team


def past_of(team: Team | None) -> Callable[[Observer], None] | None:
    """What tells an observer of the team's past, if it has a run directory."""
    if team is None:
        return None
    path, started_unix_s = team.run_dir.path, team.info.started_unix_s
    living = team.living()
    return lambda observer: tell_past(observer, path, started_unix_s, living)
