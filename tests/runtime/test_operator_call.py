"""A client's command to a team: when it is acknowledged or refused, and what it is told.

The robots are the desks of agents' contexts, each with facts of its own; a virtual clock runs.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any
from unittest import mock

import anyio
import pytest

from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.job_desk import job_rules
from mrbt_mesh.core.agent.operator_desk import OperatorDesk, team_rules
from mrbt_mesh.core.agent.operator_messages import (
    CONFLICT,
    CONTENDED,
    NOT_READY,
    CommandStep,
    command_version,
    operate_body,
)
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.records import OPERATORS, Hold, JobState
from mrbt_mesh.core.facts.store import Entry, Version, make_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.planning.job_ends import cancelled_ends
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime import operator_call
from mrbt_mesh.runtime.operator_call import ANSWER_S, CommandRefusedError, OperatorCall
from mrbt_mesh.sim.world.clock import VirtualClock, VirtualLoop
from tests.support.effort import seeds
from tests.support.paths import mission_file

MISSION = load_mission(mission_file("deliveries"))
ROBOTS = ("A", "B", "C", "D", "E")
MAJORITY = 3
NOW_US = 1_000_000_000
TEAM_FIELDS = ("paused", "aborted")


class Draws:
    """What `secrets` gives to clients, the same in every run."""

    def __init__(self) -> None:
        self._rng = random.Random(0)

    def token_hex(self, count: int) -> str:
        return self._rng.randbytes(count).hex()

    def randbelow(self, end: int) -> int:
        return self._rng.randrange(end)


def in_virtual_time(main: Callable[[], Any]) -> None:
    clock = VirtualClock()
    with mock.patch.object(operator_call, "secrets", Draws()):
        anyio.run(main, backend_options={"loop_factory": lambda: VirtualLoop(clock)})


class Robots:
    """Five robots, whose messages take a while, and some are lost. `frozen_until_s`: until when a
    robot hears nothing; `apart`: those that hear nobody else of the team.
    """

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self.frozen_until_s: dict[str, float] = {}
        self.late: list[tuple[str, list[Any]]] = []
        self.apart: set[str] = set()
        self.contexts: dict[str, Context] = {}
        self.desks: dict[str, OperatorDesk] = {}
        for name in ROBOTS:
            config = AgentConfig(name, "drone", {"look": 1_000_000}, "r", name, default_solver)
            context = self.contexts[name] = Context(MISSION, config, 0)
            context.replica.next_incarnation(0)
            assert context.wall_clock is not None
            assert context.facts.jobs is not None
            context.wall_clock.read(NOW_US, 0)
            jobs = job_rules(context)
            self.desks[name] = OperatorDesk(context, {**team_rules(context), **jobs})

    async def ask(
        self, robot: str, step: CommandStep, entry: Entry, passes_on: bool
    ) -> dict[str, Any] | None:
        body = operate_body(step, entry, passes_on)
        if self.frozen_until_s.get(robot, 0) > anyio.current_time():
            # It carries the command out when it wakes, whether or not the client still waits.
            self.late.append((robot, body))
            await anyio.sleep(60)
        await anyio.sleep(self._rng.random() * 0.02)
        if self._rng.random() < 0.05:
            await anyio.sleep(5)
        answer = self.desks[robot].take(body, round(anyio.current_time() * 1e6))
        if isinstance(answer, AwaitedAnswer):
            await anyio.sleep(self._rng.random() * 0.05)
            answer = answer.make()
        if self._rng.random() < 0.1:
            await anyio.sleep(5)
        return answer

    def exchange(self, one: str, other: str) -> None:
        """One takes over the facts of another, as after a pull, and writes what follows."""
        if (one in self.apart) is not (other in self.apart):
            return
        mine, theirs = self.contexts[one], self.contexts[other]
        mine.facts.map.merge(list(theirs.facts.map))
        if ends := cancelled_ends(mine.facts):
            mine.write(ends, 0)
        mine.facts.prune()

    def wake(self) -> None:
        """Robots that are not frozen any more carry out what has waited for them."""
        now_s, late, self.late = anyio.current_time(), self.late, []
        for robot, body in late:
            if self.frozen_until_s.get(robot, 0) > now_s:
                self.late.append((robot, body))
            else:
                self.desks[robot].take(body, round(now_s * 1e6))

    async def gossip(self) -> None:
        while True:
            await anyio.sleep(0.02)
            self.wake()
            self.exchange(*self._rng.sample(ROBOTS, 2))

    def settle(self) -> TeamFacts:
        """All faults end, and everybody hears everything."""
        self.apart.clear()
        self.frozen_until_s.clear()
        for _ in range(3):
            for one in ROBOTS:
                for other in ROBOTS:
                    self.exchange(one, other)
            self.wake()
        digests = {each.facts.map.digest() for each in self.contexts.values()}
        assert len(digests) == 1
        return self.contexts["A"].facts


class Client:
    """Commands from what it has seen: the facts of the robots that it has heard of last."""

    def __init__(self, robots: Robots, reached: Collection[str] = ROBOTS) -> None:
        self.robots = robots
        self.reached = reached
        self.stamp = 0

    async def command(self, name: str, value: Any) -> dict[str, Any]:
        def make(version: Version) -> Entry:
            self.stamp = max(self.stamp, version.incarnation.counter)
            return make_command(name, value, "me", version, "r", None)

        is_checked, reached = name not in TEAM_FIELDS, self.reached
        ask = self.robots.ask
        call = OperatorCall(make, ask, lambda: reached, ROBOTS, MAJORITY, (), is_checked)
        return (await call.carry_out(self.stamp + 1)).state


def job(content: int, shelf: str = "shelf_1") -> list[Any]:
    return ["inspect", [shelf], 0, 0, 0, content]


@pytest.mark.parametrize("seed", seeds(20))
def test_of_two_jobs_with_one_id_at_most_one_is_acknowledged(seed: int) -> None:
    async def main() -> None:
        robots = Robots(random.Random(seed))
        results: dict[int, str] = {}

        async def submit(content: int) -> None:
            try:
                await Client(robots).command("job/a", job(content))
                results[content] = "acknowledged"
            except CommandRefusedError as refusal:
                results[content] = refusal.cause
            except TimeoutError:
                results[content] = "timeout"

        async with anyio.create_task_group() as group:
            group.start_soon(robots.gossip)
            with anyio.move_on_after(15):
                async with anyio.create_task_group() as clients:
                    clients.start_soon(submit, 1)
                    clients.start_soon(submit, 2)
            group.cancel_scope.cancel()
        known = robots.settle().jobs
        assert known is not None
        found = known.known["a"].job if "a" in known.known else None
        assert sorted(results.values()) == ["acknowledged", "conflict"], f"seed {seed}"
        assert found is not None
        assert results[found.content] == "acknowledged"

    in_virtual_time(main)


@pytest.mark.parametrize("is_written", [False, True])
def test_a_job_that_one_robot_has_is_not_refused_though_another_client_was_quicker_at_the_rest(
    is_written: bool,
) -> None:
    """After the check another client has reserved the id, or written it with a later version."""

    async def main() -> None:
        robots = Robots(random.Random(1))
        other = make_command("job/a", job(2), "you", command_version(9, "b"), "r", None)

        async def ask(robot: str, step: CommandStep, *given: Any) -> dict[str, Any] | None:
            if step is CommandStep.WRITE and robot != "A" and robot not in taken:
                taken.add(robot)
                robots.desks[robot].take(operate_body(CommandStep.GIVE_UP, given[0]), 0)
                theirs = CommandStep.WRITE if is_written and robot == "B" else CommandStep.CHECK
                now_us = round(anyio.current_time() * 1e6)
                robots.desks[robot].take(operate_body(theirs, other, False), now_us)
            return await robots.ask(robot, step, *given)

        def make(version: Version) -> Entry:
            return make_command("job/a", job(1), "me", version, "r", None)

        taken = set[str]()
        async with anyio.create_task_group() as group:
            group.start_soon(robots.gossip)
            call = OperatorCall(make, ask, lambda: ROBOTS, ROBOTS, MAJORITY, (), True)
            assert (await call.carry_out(1)).state["arguments"] == ["shelf_1"]
            group.cancel_scope.cancel()
        known = robots.settle().jobs
        assert known is not None
        found = known.known["a"].job
        assert found is not None
        assert found.content == 1

    in_virtual_time(main)


def test_a_late_give_up_does_not_free_what_the_client_has_reserved_since() -> None:
    robots = Robots(random.Random(1))
    desk = robots.desks["A"]
    before, since = (
        make_command("job/a", job(1), "me", command_version(n, "a"), "r", None) for n in (1, 2)
    )
    theirs = make_command("job/a", job(2), "you", command_version(1, "b"), "r", None)
    for step, entry in [
        (CommandStep.CHECK, before),
        (CommandStep.CHECK, since),
        (CommandStep.GIVE_UP, before),
    ]:
        desk.take(operate_body(step, entry), 0)
    answer = desk.take(operate_body(CommandStep.CHECK, theirs), 0)
    assert isinstance(answer, dict)
    assert answer["cause"] == CONTENDED
    desk.take(operate_body(CommandStep.GIVE_UP, since), 0)
    assert desk.take(operate_body(CommandStep.CHECK, theirs), 0)["taken"]  # type: ignore[index]


def test_a_command_that_is_older_than_what_robots_have_is_given_a_newer_stamp() -> None:
    async def main() -> None:
        robots = Robots(random.Random(1))
        ahead, behind = Client(robots), Client(robots)
        await ahead.command("job/a", job(1))
        ahead.stamp = 50
        assert (await ahead.command("job_hold/a", "held"))["state"] == "held"
        assert (await behind.command("job_hold/a", "released"))["state"] == "open"
        facts = robots.settle()
        assert facts.jobs is not None
        assert facts.jobs.hold_of("a") is Hold.RELEASED

    in_virtual_time(main)


def test_the_state_of_a_job_is_told_by_a_robot_that_knows_the_job() -> None:
    async def ask(robot: str, *_: Any) -> dict[str, Any]:
        # B and C have the change before the job, and have seen a newer stamp.
        state = {"id": "a", "state": "held"} if robot == "A" else {"id": "a"}
        stamp = 1 if robot == "A" else 9
        return {"taken": True, "kept": True, "newest": [1, "x"], "stamp": stamp, "state": state}

    async def main() -> None:
        def make(version: Version) -> Entry:
            return make_command("job_hold/a", "held", "me", version, "r", None)

        call = OperatorCall(make, ask, lambda: ROBOTS[:3], ROBOTS, MAJORITY)
        assert (await call.carry_out(1)).state["state"] == "held"

    in_virtual_time(main)


def test_a_robot_that_wakes_late_does_not_carry_out_an_old_command() -> None:
    async def main() -> None:
        robots = Robots(random.Random(1))
        client = Client(robots)
        await client.command("job/a", job(1))
        robots.settle()
        async with anyio.create_task_group() as group:
            robots.frozen_until_s["A"] = anyio.current_time() + 30
            group.start_soon(client.command, "job_hold/a", "held")
            await anyio.sleep(5)
            # By now the others hold it for dead.
            other = Client(robots, ROBOTS[1:])
            assert (await other.command("job_hold/a", "released"))["state"] == "open"
        facts = robots.settle()
        assert facts.jobs is not None
        assert facts.jobs.hold_of("a") is Hold.RELEASED

    in_virtual_time(main)


def test_a_minority_acknowledges_nothing_and_names_who_has_not_answered() -> None:
    async def main() -> None:
        robots = Robots(random.Random(1))
        text = r"2 robots \(A, B\), and 3 were .*; C, D, E have not"
        with pytest.raises(TimeoutError, match=text):
            await Client(robots, ("A", "B")).command("paused", "pause")

    in_virtual_time(main)


def test_robots_that_would_take_a_job_are_not_said_to_be_silent() -> None:
    """Too few answer when they are asked whether they would: nothing of it is written."""

    async def main() -> None:
        robots = Robots(random.Random(1))
        for name in "CDE":
            robots.frozen_until_s[name] = 60
        text = (
            r"^nothing was written: 2 robots \(A, B\) would take it, and 3 are needed; C, D, E have"
        )
        with pytest.raises(TimeoutError, match=text):
            await Client(robots).command("job/a", job(1))
        assert robots.contexts["A"].facts.map.get(OPERATORS, "job/a") is None

    in_virtual_time(main)


def test_a_robot_that_has_to_take_a_command_is_named_if_it_is_silent() -> None:
    async def main() -> None:
        robots = Robots(random.Random(1))
        robots.frozen_until_s["C"] = 60

        def make(version: Version) -> Entry:
            return make_command("borrowed/C", "at_once", "me", version, "r", None)

        call = OperatorCall(make, robots.ask, lambda: ROBOTS, ROBOTS, 1, ("C",), True)
        text = r"^nothing was written: C has to take it, and has not answered$"
        with pytest.raises(TimeoutError, match=text):
            await call.carry_out(1)

    in_virtual_time(main)


def test_robots_whose_disks_are_full_are_not_said_to_be_silent() -> None:
    async def main() -> None:
        robots = Robots(random.Random(1))

        async def ask(robot: str, step: CommandStep, *rest: Any) -> dict[str, Any] | None:
            if step is CommandStep.WRITE and robot in "BCD":
                return None  # it waits for its journal; C was not even needed for the check
            return await robots.ask(robot, step, *rest)

        def make(version: Version) -> Entry:
            return make_command("job/a", job(1), "me", version, "r", None)

        call = OperatorCall(make, ask, lambda: ROBOTS[:4], ROBOTS, MAJORITY, (), True)
        text = (
            r"^it is in the journals of 1 robot \(A\), and 3 were asked for; "
            r"B, D have not said that it is on disk .*; C, E have not answered$"
        )
        with pytest.raises(TimeoutError, match=text):
            await call.carry_out(1)

    in_virtual_time(main)


def test_slow_answers_count_though_the_robots_were_asked_again() -> None:
    async def main() -> None:
        robots = Robots(random.Random(1))
        asked: list[str] = []

        async def ask(robot: str, *given: Any) -> dict[str, Any] | None:
            asked.append(robot)
            await anyio.sleep(2.5 * ANSWER_S)
            return await robots.ask(robot, *given)

        def make(version: Version) -> Entry:
            return make_command("paused", "pause", "me", version, "r", None)

        call = OperatorCall(make, ask, lambda: ROBOTS, ROBOTS, len(ROBOTS))
        assert (await call.carry_out(1)).robots == ROBOTS
        # After each second without an answer, and not more often.
        assert max(map(asked.count, ROBOTS)) <= anyio.current_time() / ANSWER_S + 1

    in_virtual_time(main)


def test_robots_without_a_journal_count_unless_it_is_a_job_that_they_would_forget() -> None:
    async def main() -> None:
        robots = Robots(random.Random(1))
        for name in ("A", "B", "C"):
            robots.contexts[name].durability.keeps_journal = False
        assert (await Client(robots).command("paused", "pause"))["order"] == "pause"
        text = r"2 robots \(D, E\), and 3 were .*; A, B, C keep none, for lack of --run-dir$"
        with pytest.raises(TimeoutError, match=text):
            await Client(robots).command("job/a", job(1))

    in_virtual_time(main)


def test_no_robot_that_has_joined_is_an_answer_too() -> None:
    async def main() -> None:
        async def ask(*_: Any) -> dict[str, Any]:
            return {"refused": "still joining", "cause": NOT_READY}

        def make(version: Version) -> Entry:
            return make_command("paused", "pause", "me", version, "r", None)

        call = OperatorCall(make, ask, lambda: ROBOTS, ROBOTS, MAJORITY)
        with pytest.raises(TimeoutError, match=r"0 robots \(nobody\)"):
            await call.carry_out(1)

    in_virtual_time(main)


@pytest.mark.parametrize(
    "strange", [{}, {"taken": True}, {"refused": "x"}, {"kept": True, "state": "held"}]
)
def test_a_strange_answer_is_none(strange: dict[str, Any]) -> None:
    async def main() -> None:
        robots = Robots(random.Random(1))

        async def ask(robot: str, *given: Any) -> dict[str, Any] | None:
            return strange if robot in "AB" else await robots.ask(robot, *given)

        def make(version: Version) -> Entry:
            return make_command("paused", "pause", "me", version, "r", None)

        done = await OperatorCall(make, ask, lambda: ROBOTS, ROBOTS, MAJORITY).carry_out(1)
        assert done.robots == ("C", "D", "E")
        assert done.silent == ("A", "B")

    in_virtual_time(main)


# -- random clients, and what they may rely on ------------------------------------------------


@dataclass
class Operation:
    """One command of the history: of a field of a job. `ended_s` None: nobody knows what it did."""

    name: str
    value: Any
    begun_s: float
    ended_s: float | None = None
    cause: str = ""

    @property
    def is_acknowledged(self) -> bool:
        return self.ended_s is not None and not self.cause


@dataclass
class History:
    """Commands of clients, and what docs/how-to/jobs.md promises of them."""

    operations: list[Operation] = field(default_factory=list)

    def of(self, name: str) -> list[Operation]:
        return [each for each in self.operations if each.name == name]

    def may_stand(self, name: str, value: Any) -> bool:
        """Whether a field may have this value in the end: a command gave it that was not refused,
        and no command that was acknowledged began after that one had ended.
        """
        given = [each for each in self.of(name) if not each.cause and each.value == value]
        acknowledged = [each for each in self.of(name) if each.is_acknowledged]
        if value is None:
            return not acknowledged
        return any(
            not any(e.ended_s is not None and e.ended_s < later.begun_s for later in acknowledged)
            for e in given
        )


def drawn(rng: random.Random, numbers: Iterator[int]) -> tuple[str, Any]:
    name = rng.choice(["a", "b"])
    kind = rng.choice(["job", "hold", "hold", "hold", "priority", "priority", "cancel"])
    if kind == "job":
        content = rng.choice([1, 2])
        return f"job/{name}", job(content, f"shelf_{content}")
    if kind == "cancel":
        return f"job_cancelled/{name}", True
    if kind == "priority":
        return f"job_priority/{name}", next(numbers)
    return f"job_hold/{name}", rng.choice(["held", "now", "released"])


async def faults(robots: Robots, rng: random.Random) -> None:
    """Robots freeze, and lose one another."""
    while True:
        await anyio.sleep(rng.random() * 2)
        match rng.randrange(3):
            case 0:
                frozen = rng.choice(ROBOTS)
                robots.frozen_until_s[frozen] = anyio.current_time() + rng.random() * 4
            case 1:
                robots.apart = set(rng.sample(ROBOTS, rng.randint(1, 2)))
            case 2:
                robots.apart = set()


def check(history: History, facts: TeamFacts, name: str, seed: int) -> None:
    """What has become of one job is what its clients were told."""
    jobs = facts.jobs
    assert jobs is not None
    known = jobs.known.get(name)
    found = (known.job or known.written_end) if known is not None else None
    acknowledged = {each.value[-1] for each in history.of(f"job/{name}") if each.is_acknowledged}
    assert acknowledged <= ({found.content} if found is not None else set()), (seed, name)
    for each in history.of(f"job/{name}"):
        is_same = found is not None and each.value[-1] == found.content
        assert each.cause not in (CONFLICT, CONTENDED) or not is_same, (seed, each)
    if known is None or found is None:
        return
    if any(each.is_acknowledged for each in history.of(f"job_cancelled/{name}")):
        assert known.end is not None
        assert known.end.state is JobState.CANCELLED, seed
    if known.end is not None:
        return  # of a job that has ended nothing else is kept
    commands = {n: e.record.to_value()[0] for n, e in known.commands.items()}
    for part in ("job_hold", "job_priority"):
        assert history.may_stand(f"{part}/{name}", commands.get(part)), (seed, name, part)


@pytest.mark.parametrize("seed", seeds(100))
def test_what_was_acknowledged_is_in_force_and_what_was_refused_is_not(seed: int) -> None:
    rng = random.Random(seed)
    history, numbers = History(), count(1)

    async def client(robots: Robots) -> None:
        reached = rng.choice([ROBOTS, ROBOTS, tuple(rng.sample(ROBOTS, 3))])
        mine = Client(robots, reached)
        for _ in range(6):
            await anyio.sleep(rng.random() * 3)
            name, value = drawn(rng, numbers)
            done = Operation(name, value, anyio.current_time())
            history.operations.append(done)
            try:
                await mine.command(name, value)
                done.ended_s = anyio.current_time()
            except CommandRefusedError as refusal:
                done.ended_s, done.cause = anyio.current_time(), refusal.cause
            except TimeoutError:
                pass  # it may still be carried out
            mine.stamp = max(mine.stamp - rng.randrange(3), 0)

    async def main() -> None:
        robots = Robots(rng)
        async with anyio.create_task_group() as group:
            group.start_soon(robots.gossip)
            group.start_soon(faults, robots, rng)
            async with anyio.create_task_group() as clients:
                for _ in range(3):
                    clients.start_soon(client, robots)
            await anyio.sleep(20)
            group.cancel_scope.cancel()
        for name in ("a", "b"):
            check(history, robots.settle(), name, seed)

    in_virtual_time(main)


def _given_now(original: Any, mine: OperatorDesk, body: Any) -> tuple[CommandStep, Entry, bool]:
    step, entry, passes_on = original(mine, body)
    version = command_version(mine._context.facts.max_stamp + 1, mine._context.me)
    return step, make_entry(entry.author, entry.name, version, entry.record), passes_on


def _one_fact_per_job(original: Any, mine: OperatorDesk, entry: Entry, *more: Any) -> None:
    """A change replaces what was changed before, whichever field that was."""
    original(mine, entry, *more)
    for kind in {"job_hold", "job_priority"} - {entry.parts[0]}:
        if entry.parts[0] in ("job_hold", "job_priority"):
            mine._context.facts.map.drop(OPERATORS, f"{kind}/{entry.parts[1]}")


BROKEN: dict[str, tuple[str, Callable[..., Any], Callable[[int], None]]] = {
    "late commands are news": (
        "_read",
        _given_now,
        lambda _: test_a_robot_that_wakes_late_does_not_carry_out_an_old_command(),
    ),
    "one fact per job": (
        "_write",
        _one_fact_per_job,
        test_what_was_acknowledged_is_in_force_and_what_was_refused_is_not,
    ),
    "nothing is reserved": (
        "_reserve",
        lambda *_: None,
        test_of_two_jobs_with_one_id_at_most_one_is_acknowledged,
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_deliberate_bugs_are_found(name: str) -> None:
    attribute, function, test = BROKEN[name]
    original = getattr(OperatorDesk, attribute)

    def replacement(mine: OperatorDesk, *given: Any) -> Any:
        return function(original, mine, *given)

    with mock.patch.object(OperatorDesk, attribute, replacement):
        for seed in range(40):
            try:
                test(seed)
            except AssertionError:
                return
    pytest.fail("no seed shows it")
