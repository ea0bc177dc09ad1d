"""*Check Consistency* against a matching that is made anew for every question."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.planning.consistency import Consistency, kept_requests
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
MEDIUM = {
    "sparse": Sizes(60, 60, 60, 0.15, most_wishes=1, pins=0.0),
    "types": Sizes(60, 60, 6, 0.3, most_wishes=2, pins=0.7),
    "dense": Sizes(80, 80, 1, 1.0, most_wishes=1, pins=0.2),
    "several needs": Sizes(100, 100, 100, 0.05, most_wishes=2, most_needed=2, pins=0.3),
}


class PlainMatching:
    """Keeps requests as `Consistency` does, and matches all of them again each time."""

    def __init__(self, team: Sequence[str]) -> None:
        self._team = team
        self._kept: dict[int, Sequence[Demand]] = {}

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        fits = self.fits(key, demands, pinned)
        if fits:
            self._kept[key] = demands
        return fits

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        slots = []
        for index, group in {**self._kept, key: demands}.items():
            for demand in group:
                own = sum(pinned.get(robot) == index for robot in demand.pinned)
                able = [r for r in self._team if r in demand.candidates and r not in pinned]
                slots += [able] * (demand.lower - own)
        owner: dict[str, int] = {}
        return all(_matched(slot, slots, owner, set()) for slot in range(len(slots)))


def _matched(slot: int, slots: list[list[str]], owner: dict[str, int], seen: set[str]) -> bool:
    """Kuhn's algorithm: find a robot for one slot."""
    for robot in slots[slot]:
        if robot not in seen:
            seen.add(robot)
            if robot not in owner or _matched(owner[robot], slots, owner, seen):
                owner[robot] = slot
                return True
    return False


def check(story: Story, where: str) -> None:
    groups, team, excluded = story.groups(), story.team, story.excluded
    found = kept_requests(FACTS, groups, lambda: Consistency(team), excluded)
    plain = kept_requests(FACTS, groups, lambda: PlainMatching(list(team)), excluded)
    assert found == plain, where
    assert list(found[1]) == sorted(found[1]), where


@pytest.mark.parametrize("name", SMALL)
def test_it_keeps_what_can_be_matched(name: str) -> None:
    for seed in seeds(12):
        story = Story(seed, SMALL[name])
        happened = ""
        for number in range(30):
            check(story, f"{name}, seed {seed}, event {number}: {happened}")
            happened = story.step()


@pytest.mark.slow
@pytest.mark.parametrize("name", MEDIUM)
def test_medium_teams(name: str) -> None:
    for seed in seeds(2):
        story = Story(seed, MEDIUM[name])
        for number in range(4):
            check(story, f"{name}, seed {seed}, event {number}")
            story.step()


def test_a_robot_that_claims_two_requests_is_counted_for_the_later_one() -> None:
    groups = [[demand(0, 1, "A", pinned="A")], [demand(1, 1, "A", pinned="A")]]
    found = kept_requests(FACTS, groups, lambda: Consistency({"A": WORKER}))
    assert found == ([1], {"A": 1})


@given(st.integers(0, 10**9))
def test_keeping_one_after_the_other_with_pins(seed: int) -> None:
    story = Story(seed, SMALL["crowded"])
    groups, team = story.groups(), story.team
    pinned = {r: i for i, group in enumerate(groups) for d in group for r in d.pinned}
    found, plain = Consistency(team), PlainMatching(list(team))
    kept = []
    for index, group in enumerate(groups):
        fits = plain.fits(index, group, pinned)
        assert found.fits(index, group, pinned) == fits
        assert found.keep(index, group, pinned) == plain.keep(index, group, pinned) == fits
        kept += [index] * fits
        check_matching(groups, found.matched, pinned, kept)


def check_matching(
    groups: list[list[Demand]],
    matched: Mapping[str, int],
    pinned: Mapping[str, int],
    kept: Sequence[int],
) -> None:
    """Each request has as many robots as it needs, that can do some of it."""
    needed = [
        demand.lower - sum(pinned.get(robot) == index for robot in demand.pinned)
        for index in kept
        for demand in groups[index]
    ]
    assert len(matched) == sum(max(0, each) for each in needed)
    for robot, index in matched.items():
        assert index in kept
        assert robot not in pinned
        assert any(robot in demand.candidates for demand in groups[index])


def demand(index: int, lower: int, candidates: str, pinned: str = "") -> Demand:
    request = Request(index, "calm", f"a{index}")
    return Demand(request, "k", lower, lower, 9, tuple(pinned), dict.fromkeys(candidates, 1))
