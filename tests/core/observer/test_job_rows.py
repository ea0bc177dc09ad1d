"""Rows that are kept from one look to the next are those that would be made anew."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.agent.job_desk import CHANGE_JOB, SUBMIT
from mrbt_mesh.core.observer.job_rows import JobRows
from tests.support.one_robot import desk

NAMES = [f"job-{number}" for number in range(30)]
CHANGES = st.tuples(
    st.sampled_from(["cancel", "hold", "release", "priority"]),
    st.sampled_from(NAMES),
    st.integers(-2, 2),
)


@given(st.lists(CHANGES, max_size=12))
def test_kept_rows_are_as_new_ones(changes: list[tuple[str, str, int]]) -> None:
    """More jobs than are in the tree at a time: others come into it when one is cancelled."""
    (robot, context), kept = desk(), JobRows()
    for name in NAMES:
        job = {"id": name, "type": "inspect", "arguments": ["shelf_1"], "operator": "me"}
        robot.answer(SUBMIT, json.dumps(job), 0)
    before = kept.update(context.facts, None, ())
    assert [row.why for row in before].count("behind others") == len(NAMES) - 20
    for change, name, priority in changes:
        given = {"id": name, "change": change}
        more = {"priority": priority} if change == "priority" else {}
        robot.answer(CHANGE_JOB, json.dumps(given | more), 0)
        context.facts.prune()
        rows = kept.update(context.facts, None, ())
        assert rows == JobRows().update(context.facts, None, ())
    places = {"held": 0, "waiting": 0}
    ranks = [places.get(row.state, 1) for row in kept.update(context.facts, None, ())]
    assert ranks == sorted(ranks)
