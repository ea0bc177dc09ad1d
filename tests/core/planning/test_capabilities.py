"""What is known of a team's capabilities is that of a team which is looked up anew."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.facts.records import Member
from mrbt_mesh.core.planning import capabilities
from mrbt_mesh.core.planning.capabilities import Capabilities, RobotMasks, Worker

ROBOTS = [f"R{number:02}" for number in range(30)]
LOCAL_TASKS = ("lift", "lift(1)", "lift(2)", "weld", "weld(1)")

members = st.builds(
    Member,
    st.just("T"),
    st.dictionaries(st.sampled_from(LOCAL_TASKS), st.integers(0, 9)),
    st.dictionaries(st.sampled_from(LOCAL_TASKS), st.just("broken"), max_size=1),
    st.just(False),
    st.just(""),
    st.just(""),
    st.just(0),
)
workers = st.builds(Worker, st.just("R"), members, st.tuples(st.integers(1, 2), st.just("n")))
# Which robots differ in the next team; None: it has left.
changes = st.dictionaries(st.sampled_from(ROBOTS), st.none() | workers, max_size=4)


@given(st.lists(workers, min_size=25, max_size=25), st.lists(changes, max_size=6), st.data())
def test_those_of_the_next_team(
    first: Sequence[Worker], stories: Sequence[dict[str, Worker | None]], data: st.DataObject
) -> None:
    team = dict(zip(ROBOTS, first, strict=False))
    kept = Capabilities(team)
    for changed in stories:
        for local_task in data.draw(st.sets(st.sampled_from(LOCAL_TASKS))):
            kept.able(local_task)
        after = team | changed
        team = {r: worker for r in sorted(after) if (worker := after[r]) is not None}
        kept, fresh = kept.after(team), Capabilities(team)
        assert kept.team == team
        for local_task in LOCAL_TASKS:
            able = kept.able(local_task)
            assert list(able.items()) == list(fresh.able(local_task).items())
            mask = kept.masks.of(able)
            assert mask == kept.masks.of(list(able))
            numbers = [n for n in range(mask.bit_length()) if mask >> n & 1]
            assert sorted(kept.masks.robots[number] for number in numbers) == list(able)


def test_what_is_the_same_is_kept() -> None:
    worker = Worker("A", Member("T", {"lift": 1}, {}, False, "", "", 0), (1, "n"))
    team = dict.fromkeys(ROBOTS, worker)
    kept = Capabilities(team)
    lift = kept.able("lift")
    assert kept.after(dict(team)) is kept
    lame = Worker("A", Member("T", {"weld": 1}, {}, False, "", "", 0), (1, "n"))
    fewer = kept.after(team | {"R03": lame})
    assert "R03" in lift
    assert "R03" not in fewer.able("lift")
    fewer.able("weld")
    assert fewer.after(team).able("weld") == {}


def test_what_was_looked_up_long_ago_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each job of a mission that never ends may bring local tasks of its own."""
    monkeypatch.setattr(capabilities, "MOST_LOCAL_TASKS", 3)
    worker = Worker("A", Member("T", {"lift": 1}, {}, False, "", "", 0), (1, "n"))
    kept = Capabilities(dict.fromkeys(ROBOTS, worker))
    for number in range(100):
        assert list(kept.able(f"lift({number})")) == list(ROBOTS)
    assert list(kept._able) == ["lift(97)", "lift(98)", "lift(99)"]
    assert len(kept.masks._remembered) == 3
    assert list(kept.able("lift(1)")) == list(ROBOTS)


def test_robots_without_a_bit_are_left_out() -> None:
    masks = RobotMasks(["A", "B"])
    assert masks.of(["B", "C"]) == 0b10
