"""The large team that the page is measured with: as large as is said, and changing all the time."""

from __future__ import annotations

from benchmarks.page.frames import NODES_PER_CHANGE, ROBOTS, _MadeUp, mission
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.web.feed import Feed


def test_it_is_large_and_changes() -> None:
    large = mission()
    assert 1_900 <= len(large.tree.nodes) <= 2_100
    observer = Observer(large, "r", Timing(200_000, 1_000_000), default_solver)
    feed = Feed(TeamView(observer), lambda: 0)
    made_up = _MadeUp(feed)
    made_up.change()
    items = feed.view.changes.since(0)
    assert len([key for key in items if key.startswith("robot/")]) == ROBOTS
    assert len([key for key in items if key.startswith("node/")]) == NODES_PER_CHANGE
    version = feed.view.changes.version
    made_up.change()
    changed = feed.view.changes.since(version)
    assert len([key for key in changed if key.startswith("node/")]) > NODES_PER_CHANGE / 2
