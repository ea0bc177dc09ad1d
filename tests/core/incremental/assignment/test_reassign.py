"""The optimum kept up to date is the canonical one, after any sequence of changes."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.problem import SolverError
from mrbt_mesh.core.assignment.solve import named
from mrbt_mesh.core.assignment.solve import optimum as from_scratch
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.incremental.assignment import optimum as optimum_module
from mrbt_mesh.core.incremental.assignment import reassign as reassign_module
from mrbt_mesh.core.incremental.assignment import residual as residual_module
from mrbt_mesh.core.incremental.assignment import ties as ties_module
from mrbt_mesh.core.incremental.assignment.arc_costs import ENTRY, IDLE
from mrbt_mesh.core.incremental.assignment.optimum import Optimum
from mrbt_mesh.core.incremental.assignment.problem_changes import ProblemChanges, difference
from mrbt_mesh.core.incremental.assignment.reassign import Reassigner
from mrbt_mesh.core.incremental.assignment.residual import InfeasibleError, TooFarError
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE
from tests.support.effort import seeds
from tests.support.problems import optima

KINDS = ["dies", "comes", "request", "ended", "bounds", "option"]
VALUES = [1, 3, 10, 1000]


def assigned(team: NamedProblem) -> dict[str, str] | None:
    """By definition: from scratch."""
    return from_scratch(team, min_cost_flow)


def check_prices(optimum: Optimum) -> None:
    """No move and no arc of the bounds costs less than nothing: this proves the optimum, whatever
    found it."""
    residual = optimum._residual
    options = residual.options
    for node, robots in enumerate(residual.members):
        for robot in robots:
            assert residual.place[robot] == node
            here = options.performance(robot, node)
            assert here is not None
            assert options.level(robot) == here - options.price(node)
            assert options.is_content(robot)
        if node not in (IDLE, ENTRY):
            price = options.price(node) - options.price(IDLE)
            assert residual.lower[node] <= len(robots) <= residual.upper[node]
            assert residual.required[node] == len(robots)
            assert len(robots) == residual.upper[node] or price <= 0
            assert len(robots) == residual.lower[node] or price >= 0
    assert not residual.members[ENTRY]
    assert not residual.missing


class Story:
    """A team to which things happen."""

    def __init__(self, seed: int, size: int, most: int) -> None:
        self.random = random.Random(seed)
        self.most = most
        self.size = size
        self.names = [f"r{number:02d}" for number in range(2 * size)]
        self.share = self.random.choice((0.2, 0.5, 1.0))
        self.offered = 0
        robots = sorted(self.random.sample(self.names, size))
        self.team = NamedProblem(tuple(robots), tuple(self.offer() for _ in range(size // 3)))

    def offer(self) -> NamedDemand:
        self.offered += 1
        rng = self.random
        lower = rng.choice((0, 0, 1, 2))
        able = [robot for robot in self.names if rng.random() < self.share]
        candidates = {robot: rng.randint(1, self.most) for robot in able}
        return NamedDemand(f"d{self.offered}", lower, lower + rng.choice((0, 0, 1, 2)), candidates)

    def next(self, *kinds: str) -> NamedProblem:
        robots, demands = list(self.team.robots), list(self.team.demands)
        for kind in kinds or self.random.choices(KINDS, k=self.random.choice((1, 1, 1, 2, 4))):
            getattr(self, f"_{kind}")(robots, demands)
        self.team = NamedProblem(tuple(sorted(robots)), tuple(demands))
        return self.team

    def _dies(self, robots: list[str], demands: list[NamedDemand]) -> None:
        if robots:
            robots.remove(self.random.choice(robots))

    def _comes(self, robots: list[str], demands: list[NamedDemand]) -> None:
        away = [robot for robot in self.names if robot not in robots]
        if away:
            robots.append(self.random.choice(away))

    def _request(self, robots: list[str], demands: list[NamedDemand]) -> None:
        if len(demands) < self.size:
            demands.insert(self.random.randint(0, len(demands)), self.offer())

    def _ended(self, robots: list[str], demands: list[NamedDemand]) -> None:
        if demands:
            demands.remove(self.random.choice(demands))

    def _bounds(self, robots: list[str], demands: list[NamedDemand]) -> None:
        if demands:
            index = self.random.randrange(len(demands))
            old = demands[index]
            lower = max(0, old.lower + self.random.choice((-1, 0, 1)))
            upper = max(lower, old.upper + self.random.choice((-1, 0, 1)))
            demands[index] = replace(old, lower=lower, upper=upper)

    def _option(self, robots: list[str], demands: list[NamedDemand]) -> None:
        if demands:
            index = self.random.randrange(len(demands))
            candidates = dict(demands[index].candidates)
            robot = self.random.choice(self.names)
            if self.random.random() < 0.5:
                candidates.pop(robot, None)
            else:
                candidates[robot] = self.random.randint(1, self.most)
            demands[index] = replace(demands[index], candidates=candidates)


@pytest.fixture(params=["sparse", "dense"])
def storage(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Both ways to store what robots can do, whatever share of the pairs that is."""
    monkeypatch.setattr(optimum_module, "DENSE", 2.0 if request.param == "sparse" else -1.0)
    return str(request.param)


@pytest.fixture(params=["one end", "both ends"])
def search(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Small problems as if they were large: searched from both ends at once."""
    monkeypatch.setattr(residual_module, "HEAD_START", 1 if request.param == "both ends" else 99)
    return str(request.param)


@pytest.fixture(params=["few options", "many options"])
def ties(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Only what is on cycles is looked at, or everything."""
    monkeypatch.setattr(ties_module, "FEW", 1000 if request.param == "few options" else 0)
    return str(request.param)


def follow(seed: int, size: int, events: int, most: int) -> Iterator[tuple[NamedProblem, Optimum]]:
    """The team and the optimum that has been kept up to date, event by event."""
    story = Story(seed, size, most)
    before, kept = story.team, None
    for _ in range(events):
        if kept is None:
            found = assigned(before)
            kept = None if found is None else Optimum(before, found)
        after = story.next()
        changes = difference(before, after)
        before = after
        assert changes is not None
        if kept is None:
            continue
        try:
            kept.apply(changes)
        except InfeasibleError:
            assert assigned(after) is None
            kept = None
        else:
            yield after, kept


@pytest.mark.parametrize("most", VALUES)
def test_after_every_event_it_is_what_brute_force_finds(
    storage: str, search: str, ties: str, most: int
) -> None:
    for seed in seeds(4):
        for team, optimum in follow(seed, 4, 50, most):
            best = named(team, optima(team.problem())[0])
            assert optimum.assigned == best, f"{seed=} {most=}"
            check_prices(optimum)


@pytest.mark.parametrize("most", VALUES)
@pytest.mark.parametrize(("size", "events"), [(8, 200), (30, 60)])
def test_after_every_event_it_is_what_scratch_finds(
    storage: str, search: str, ties: str, size: int, events: int, most: int
) -> None:
    for seed in seeds(2):
        for team, optimum in follow(seed, size, events, most):
            assert optimum.assigned == assigned(team), f"{seed=} {size=} {most=}"
            check_prices(optimum)


def test_who_has_lost_a_demand_goes_where_somebody_is_missing(storage: str, search: str) -> None:
    """Straight, although the way by those who are idle is open too."""
    able = dict.fromkeys(["a", "b", "c", "d", "e"], 5)
    demands = tuple(NamedDemand(name, 2, 2, able) for name in ("x", "y"))
    team = NamedProblem(("a", "b", "c", "d", "e"), demands)
    optimum = Optimum(team, assigned(team) or {})
    # b, of y's, is not there any more, and neither is x, which a and b were on.
    after = NamedProblem(("a", "c", "d", "e"), demands[1:])
    optimum.apply(difference(team, after) or ProblemChanges())
    assert optimum.assigned == assigned(after) == {"a": "y", "c": "y"}
    check_prices(optimum)


@given(st.integers(0, 10**9), st.integers(3, 8), st.sampled_from(VALUES))
@settings(max_examples=30)
def test_any_story(seed: int, size: int, most: int) -> None:
    for team, optimum in follow(seed, size, 20, most):
        assert optimum.assigned == assigned(team)
        check_prices(optimum)


@pytest.mark.parametrize("size", [5, 30])
def test_update_gives_what_scratch_gives_whatever_has_changed(
    storage: str, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it has to solve again: many changes, no solution, visits that go too far."""
    for seed in seeds(8):
        story = Story(seed, size, VALUES[seed % 4])
        reassigner = Reassigner(assigned, smallest_team=1)
        monkeypatch.setattr(reassign_module, "ROBOTS_PER_VISIT", (1, 5)[seed % 2])
        for number in range(60):
            kinds = ["comes", "dies", "request", "bounds"] * 10 if number % 20 == 10 else []
            team = story.next(*kinds)
            expected = assigned(team)
            found = reassigner.update(team)
            assert (found and dict(found)) == (expected and dict(expected)), f"{seed=} {size=}"
            assert (found is None) == (expected is None)
            if number % 7 == 0:
                reassigner.prepare()


class Scratch:
    """Counts how often it is asked."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, team: NamedProblem) -> dict[str, str] | None:
        self.calls += 1
        return assigned(team)


def small_changes(team: NamedProblem, count: int) -> Iterator[NamedProblem]:
    for number in range(count):
        yield replace(team, robots=tuple(r for r in team.robots if r != team.robots[number]))


def test_a_calm_large_team_is_not_solved_again() -> None:
    story = Story(5, 120, 1000)
    story.team = replace(story.team, demands=story.team.demands[:20])
    scratch = Scratch()
    reassigner = Reassigner(scratch)
    reassigner.update(story.team)
    reassigner.prepare()
    for team in small_changes(story.team, 9):
        assert dict(reassigner.update(team) or {}) == assigned(team)
    assert scratch.calls == 1


def test_without_being_prepared_it_waits_for_a_second_small_change() -> None:
    story = Story(5, 120, 1000)
    scratch = Scratch()
    reassigner = Reassigner(scratch)
    for team in small_changes(story.team, 9):
        reassigner.update(team)
    assert scratch.calls == 2


def test_after_reaching_too_far_it_pauses_ever_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reassign_module, "ROBOTS_PER_VISIT", 10**9)
    monkeypatch.setattr(reassign_module, "PAIRS_PER_VISIT", 10**9)
    story = Story(5, 120, 1000)
    demand = replace(story.offer(), lower=110, upper=110, candidates=dict.fromkeys(story.names, 1))
    story.team = replace(story.team, demands=(demand, NamedDemand("nobody's", 0, 1, {})))
    scratch = Scratch()
    reassigner = Reassigner(scratch)
    reassigner.update(story.team)
    tried = []
    for team in small_changes(story.team, 20):
        reassigner.prepare()
        tried.append(reassigner._optimum is not None)
        assert dict(reassigner.update(team) or {}) == assigned(team)
    assert tried == [True, *[False] * 3, True, *[False] * 9, True, *[False] * 5]
    assert scratch.calls == 21


def test_a_small_team_is_always_solved_again() -> None:
    story = Story(5, 20, 1000)
    scratch = Scratch()
    reassigner = Reassigner(scratch)
    for team in small_changes(story.team, 5):
        reassigner.update(team)
        reassigner.prepare()
    assert scratch.calls == 5


def test_demands_in_another_order_are_another_problem() -> None:
    one, other = NamedDemand("a", 0, 1, {"r": 1}), NamedDemand("b", 0, 1, {"r": 1})
    reassigner = Reassigner(assigned, smallest_team=1)
    for demands, expected in [((one, other), "a"), ((other, one), "b"), ((one, other), "a")]:
        assert reassigner.update(NamedProblem(("r",), demands)) == {"r": expected}
        reassigner.prepare()


def test_what_has_not_changed_is_not_looked_at() -> None:
    class Untouchable(dict[str, int]):
        def items(self) -> object:  # type: ignore[override]
            raise AssertionError

        __eq__ = items  # type: ignore[assignment]

    demands = tuple(NamedDemand(f"d{i}", 0, 1, Untouchable(r=1, s=2)) for i in range(3))
    old = NamedProblem(("r", "s"), demands)
    new = NamedProblem(("r", "s"), (replace(demands[0], upper=2), *demands[1:]))
    assert difference(old, new) == ProblemChanges(bounds={"d0": (0, 2)})
    assert difference(old, replace(old, robots=("r",))) == ProblemChanges(gone_robots=["s"])


def test_many_new_requests_at_one_place_of_the_order() -> None:
    """Beyond the room between two ranks."""
    candidates = {"r": 1, "s": 1}
    team = NamedProblem(
        ("r", "s"), (NamedDemand("a", 0, 1, candidates), NamedDemand("z", 0, 1, candidates))
    )
    optimum = Optimum(team, assigned(team) or {})
    for number in range(40):
        new = NamedDemand(f"b{number}", 0, 1, candidates)
        after = NamedProblem(team.robots, (team.demands[0], new, *team.demands[1:]))
        optimum.apply(difference(team, after) or ProblemChanges())
        assert optimum.assigned == assigned(after) == {"r": "a", "s": new.id}
        team = after


def test_robots_never_seen_before_come_anywhere_in_the_order() -> None:
    names = [f"r{number:02d}" for number in range(40)]
    demand = NamedDemand("a", 0, 2, dict.fromkeys(names, 1))
    team = NamedProblem((), (demand,))
    optimum = Optimum(team, {})
    for name in random.Random(1).sample(names, 40):
        after = NamedProblem(tuple(sorted((*team.robots, name))), (demand,))
        optimum.apply(difference(team, after) or ProblemChanges())
        assert optimum.assigned == dict.fromkeys(after.robots[:2], "a")
        team = after


@pytest.mark.parametrize("most", [MAX_PERFORMANCE, 1 << 56])
def test_performances_beyond_what_a_matrix_may_hold(storage: str, most: int) -> None:
    team = NamedProblem(("r", "s"), (NamedDemand("a", 0, 1, {"r": most, "s": most - 1}),))
    optimum = Optimum(team, {"r": "a"})
    optimum.apply(ProblemChanges(gone_robots=["r"]))
    assert optimum.assigned == {"s": "a"}
    optimum.apply(ProblemChanges(new_robots={"r": {"a": most}}))
    assert optimum.assigned == {"r": "a"}


def test_prices_stay_small_however_long_it_runs(
    storage: str, search: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(residual_module, "MAX_DISTANCE", 4)
    for team, optimum in follow(3, 6, 200, 10):
        assert abs(optimum._residual.options.price(IDLE)) <= 10 * len(team.demands)
        assert optimum.assigned == assigned(team)
        check_prices(optimum)


@pytest.mark.parametrize("wrong", [{"r": "b", "s": "a"}, {"r": "a"}])
def test_what_is_not_the_canonical_optimum_is_refused(
    storage: str, wrong: Mapping[str, str]
) -> None:
    candidates = {"r": 1, "s": 1}
    team = NamedProblem(
        ("r", "s"), (NamedDemand("a", 0, 1, candidates), NamedDemand("b", 0, 1, candidates))
    )
    with pytest.raises(SolverError):
        Optimum(team, wrong)


def test_visits_may_be_limited() -> None:
    team = NamedProblem(("r", "s"), (NamedDemand("a", 1, 1, {"r": 1, "s": 1}),))
    with pytest.raises(TooFarError):
        Optimum(team, {"r": "a"}).apply(ProblemChanges(gone_robots=["r"]), visits=0)


def test_after_a_solver_has_failed_the_same_problem_is_solved_again() -> None:
    answers: list[tuple[int, ...]] = []

    def fails_at_first(team: NamedProblem) -> dict[str, str] | None:
        if not answers:
            answers.append(())
            raise SolverError("not yet")
        return assigned(team)

    demands = (NamedDemand("x", 1, 1, {"a": 1, "b": 2}), NamedDemand("y", 1, 1, {"a": 1, "b": 1}))
    team = NamedProblem(("a", "b"), demands)
    keeper = Reassigner(fails_at_first)
    with pytest.raises(SolverError, match="not yet"):
        keeper.update(team)
    assert keeper.update(team) == assigned(team) == {"a": "y", "b": "x"}
