"""*Check Consistency* brought up to date, against its definition, after every event."""

from __future__ import annotations

import random
from collections.abc import Collection, Mapping, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.incremental.consistency.keeper import (
    FEW_REQUESTS,
    BitsetConsistency,
    ConsistencyKeeper,
)
from mrbt_mesh.core.planning.capabilities import Worker
from mrbt_mesh.core.planning.consistency import Consistency, Kept, kept_requests
from mrbt_mesh.core.planning.demands import Demand
from tests.support.consistency_stories import WORKER, Sizes, Story, facts
from tests.support.effort import seeds

FACTS = facts()

SMALL = {
    "crowded": Sizes(5, 5, 3, 0.6),
    "tight": Sizes(6, 8, 6, 0.4, most_needed=2, most_wishes=2),
    "many pins": Sizes(6, 4, 3, 0.7, pins=1.0),
    "one kind": Sizes(6, 8, 1, 0.9, most_needed=3),
    "two of each": Sizes(9, 12, 3, 0.6, most_needed=2, most_wishes=1, pins=0.2),
    "grabbing": Sizes(6, 5, 3, 0.6, grabbing=0.2),
    "long": Sizes(12, 30, 12, 0.25, most_needed=2, most_wishes=2, pins=0.3),
    "longer": Sizes(25, 40, 40, 0.12, most_needed=2, most_wishes=2, pins=0.4),
}


def by_definition(
    groups: Sequence[Sequence[Demand]], team: Mapping[str, Worker], excluded: Collection[int] = ()
) -> Kept:
    return kept_requests(FACTS, groups, lambda: Consistency(team), excluded)


def follow(story: Story, steps: int, label: str, keeper: ConsistencyKeeper) -> None:
    """Ask a keeper after every event, and compare with the definition."""
    happened: list[str] = []
    for number in range(steps):
        groups, team, excluded = story.groups(), story.team, story.excluded
        found = keeper.kept_requests(FACTS, groups, team, excluded)
        wanted = by_definition(groups, team, excluded)
        where = f"{label}: after event {number}, {', '.join(happened)}"
        assert found == wanted, where
        assert list(found[1]) == sorted(found[1]), where
        happened = [story.step()]
        while story.coin(0.3):
            happened.append(story.step())


@pytest.mark.parametrize("name", SMALL)
def test_every_event_by_itself(name: str) -> None:
    """However few requests there are, and however much has changed."""
    for seed in seeds(12):
        keeper = ConsistencyKeeper(few_requests=0, requests_per_change=0)
        follow(Story(seed, SMALL[name]), 80, f"{name}, seed {seed}", keeper)


@pytest.mark.parametrize("few_requests", [0, FEW_REQUESTS])
@pytest.mark.parametrize("name", SMALL)
def test_whatever_happens_the_keeper_answers_like_the_definition(
    name: str, few_requests: int
) -> None:
    for seed in seeds(12):
        keeper = ConsistencyKeeper(few_requests)
        follow(Story(seed, SMALL[name]), 80, f"{name}, seed {seed}", keeper)


@pytest.mark.parametrize(
    "sizes",
    [
        Sizes(60, 60, 60, 0.15, most_wishes=1, pins=0.0),
        Sizes(60, 60, 6, 0.3, most_wishes=2, pins=0.7),
        Sizes(80, 80, 1, 1.0, most_wishes=1, pins=0.2),
        Sizes(100, 100, 100, 0.05, most_wishes=2, most_needed=2, pins=0.3),
    ],
    ids=["sparse", "types", "dense", "several needs"],
)
def test_medium_teams(sizes: Sizes) -> None:
    for seed in seeds(2):
        follow(Story(seed, sizes), 60, f"{sizes}, seed {seed}", ConsistencyKeeper())


@given(st.integers(0, 10**9), st.sampled_from(sorted(SMALL)))
def test_from_scratch_it_answers_like_the_definition(seed: int, name: str) -> None:
    story = Story(seed, SMALL[name])
    for _ in range(3):
        groups, team, excluded = story.groups(), story.team, story.excluded
        found = ConsistencyKeeper(few_requests=0).kept_requests(FACTS, groups, team, excluded)
        assert found == by_definition(groups, team, excluded)
        story.step()


def test_a_robot_that_claims_two_requests_is_counted_for_the_later_one() -> None:
    groups = [[demand(0, 1, "A", pinned="A")], [demand(1, 1, "A", pinned="A")]]
    team = {"A": WORKER}
    keeper = ConsistencyKeeper(few_requests=0)
    for _ in range(2):
        found = keeper.kept_requests(FACTS, groups, team)
        assert found == by_definition(groups, team) == ([1], {"A": 1})


def test_candidates_out_of_the_team_count_once_they_come() -> None:
    groups = [[demand(index, 1, "AB")] for index in range(20)]
    keeper = ConsistencyKeeper()
    for team, count in (("A", 1), ("AB", 2), ("B", 1), ("AB", 2), ("", 0), ("A", 1)):
        found = keeper.kept_requests(FACTS, groups, dict.fromkeys(team, WORKER))
        assert found == (list(range(count)), {}), team


def test_robots_that_come_and_go_for_a_long_time() -> None:
    groups = [[demand(index, 1, "AB")] for index in range(20)]
    keeper = ConsistencyKeeper()
    for number in range(300):
        team = dict.fromkeys("AB" if number % 2 else "B", WORKER)
        assert keeper.kept_requests(FACTS, groups, team)[0] == list(range(1 + number % 2))


def test_requests_may_change_places() -> None:
    groups = [[demand(index, 1, "AB")] for index in range(20)]
    keeper, team = ConsistencyKeeper(), dict.fromkeys("AB", WORKER)
    for seed in seeds(10):
        random.Random(seed).shuffle(groups)
        assert keeper.kept_requests(FACTS, groups, team)[0] == [0, 1], f"seed {seed}"


def test_many_requests_come_in_at_one_place() -> None:
    groups = [[demand(index, 1, "AB")] for index in range(40)]
    keeper, team = ConsistencyKeeper(), dict.fromkeys("AB", WORKER)
    for number in range(40, 200):
        groups.insert(1, [demand(number, 1, "B")])
        wanted = by_definition(groups, team)
        assert keeper.kept_requests(FACTS, groups, team) == wanted


@given(st.integers(0, 10**9))
def test_keeping_one_after_the_other_with_pins(seed: int) -> None:
    story = Story(seed, SMALL["crowded"])
    groups, team = story.groups(), story.team
    pinned = {r: i for i, group in enumerate(groups) for d in group for r in d.pinned}
    fast, plain = BitsetConsistency(team), Consistency(team)
    for index, group in enumerate(groups):
        fits = plain.fits(index, group, pinned)
        assert fast.fits(index, group, pinned) == fits
        assert fast.keep(index, group, pinned) == plain.keep(index, group, pinned) == fits
        check_matching(groups, fast.matched, pinned, plain.matched)


def check_matching(
    groups: list[list[Demand]],
    matched: Mapping[str, int],
    pinned: Mapping[str, int],
    others: Mapping[str, int],
) -> None:
    """Each request has as many robots as it needs, that can do some of it."""
    assert sorted(matched.values()) == sorted(others.values())
    for robot, index in matched.items():
        assert robot not in pinned
        assert any(robot in demand.candidates for demand in groups[index])


def demand(index: int, lower: int, candidates: str, pinned: str = "") -> Demand:
    request = Request(index, "calm", f"a{index}")
    return Demand(request, "k", lower, lower, 9, tuple(pinned), dict.fromkeys(candidates, 1))
