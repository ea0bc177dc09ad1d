"""Rows that are kept from one look to the next are those that would be made anew."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.job_desk import CHANGE_JOB, SUBMIT, JobDesk
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.observer.job_rows import JobRows
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.paths import mission_file

MISSION = load_mission(mission_file("deliveries"))
NAMES = [f"job-{number}" for number in range(30)]
CHANGES = st.tuples(
    st.sampled_from(["cancel", "hold", "release", "priority"]),
    st.sampled_from(NAMES),
    st.integers(-2, 2),
)


@given(st.lists(CHANGES, max_size=12))
def test_kept_rows_are_as_new_ones(changes: list[tuple[str, str, int]]) -> None:
    """More jobs than are in the tree at a time: others come into it when one is cancelled."""
    config = AgentConfig("D1", "drone", {"look": 1_000_000}, "r", "n", default_solver)
    context = Context(MISSION, config, 0)
    context.replica.next_incarnation(0)
    assert context.facts.jobs is not None
    assert context.wall_clock is not None
    context.wall_clock.read(1_000_000_000, 0)
    desk, kept = JobDesk(context, context.facts.jobs), JobRows()
    for name in NAMES:
        job = {"id": name, "type": "inspect", "arguments": ["shelf_1"], "operator": "me"}
        desk.answer(SUBMIT, json.dumps(job), 0)
    before = kept.update(context.facts, None, ())
    assert [row.why for row in before].count("behind others") == len(NAMES) - 20
    for change, name, priority in changes:
        given = {"id": name, "change": change}
        more = {"priority": priority} if change == "priority" else {}
        desk.answer(CHANGE_JOB, json.dumps(given | more), 0)
        context.facts.prune()
        rows = kept.update(context.facts, None, ())
        assert rows == JobRows().update(context.facts, None, ())
    places = {"held": 0, "waiting": 0}
    ranks = [places.get(row.state, 1) for row in kept.update(context.facts, None, ())]
    assert ranks == sorted(ranks)
