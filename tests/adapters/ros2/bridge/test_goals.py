"""Goals: said step by step, and against a model of servers that lose, restart and refuse."""

from __future__ import annotations

from collections.abc import Iterable

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from mrbt_mesh.adapters.ros2.bridge.goals import (
    ABORTED,
    ACCEPT_S,
    AGAIN_S,
    CANCELED,
    OBEY_S,
    SUCCEEDED,
    TERMINATED,
    UNKNOWN,
    UNKNOWN_GOAL,
    GoalKeeper,
)
from mrbt_mesh.adapters.ros2.bridge.server import (
    AskLife,
    AskResult,
    CancelGoal,
    RunEnded,
    SendGoal,
    ServerEffect,
    ServerTold,
)
from mrbt_mesh.adapters.ros2.bridge.watch import LISTED_S

ONE, TWO, THREE = b"1" * 16, b"2" * 16, b"3" * 16
SILENT = ServerTold(False, "does not answer while it works: does it have one thread only?")
# A goal is at its server by then. A cancellation that came before it is sent again.
ARRIVES_S = AGAIN_S


def ready() -> GoalKeeper:
    """A keeper whose server was heard at 0 s."""
    keeper = GoalKeeper(1.0, 0.0)
    assert keeper.heard(0.0) == [ServerTold(True, "")]
    return keeper


def accepted(now_s: float = 0.1) -> GoalKeeper:
    """One whose server has accepted goal ONE of run 7."""
    keeper = ready()
    keeper.start(7, ONE, {}, now_s)
    keeper.answered(ONE, True, now_s)
    return keeper


def test_a_goal_from_begin_to_end() -> None:
    keeper = ready()
    assert keeper.start(7, ONE, {"x": 1}, 0.1) == [SendGoal(7, ONE, {"x": 1})]
    assert keeper.answered(ONE, True, 0.2) == [AskResult(ONE)]
    assert keeper.run_of(ONE) == 7
    assert not keeper.is_clear
    ended = keeper.result(ONE, SUCCEEDED, "fine", {"n": 3}, 0.5)
    assert ended == [RunEnded(7, "succeeded", "fine", {"n": 3})]
    assert keeper.is_clear


def test_how_it_may_end_otherwise() -> None:
    keeper = ready()
    for status, how in ((ABORTED, "aborted"), (CANCELED, "cancelled"), (UNKNOWN, "lost")):
        keeper.start(7, ONE, {}, 0.1)
        keeper.answered(ONE, True, 0.1)
        assert keeper.result(ONE, status, "why", {}, 0.2) == [RunEnded(7, how, "why", {})]
    keeper.start(8, TWO, {}, 0.3)
    assert keeper.answered(TWO, False, 0.3) == [RunEnded(8, "rejected", "", {})]
    keeper.start(9, ONE, {}, 0.4)
    assert keeper.refused(9, "no field x", 0.4) == [RunEnded(9, "unfit", "no field x", {})]
    assert keeper.is_clear


def test_it_waits_for_a_server_that_is_not_there() -> None:
    keeper = GoalKeeper(1.0, 0.0)
    assert keeper.start(7, ONE, {}, 0.1) == []
    assert keeper.cancel(7, 0.2) == [RunEnded(7, "cancelled", "", {})]
    keeper.start(8, TWO, {}, 0.3)
    assert keeper.heard(0.4) == [SendGoal(8, TWO, {}), ServerTold(True, "")]


def test_it_does_not_wait_for_ever() -> None:
    keeper = GoalKeeper(1.0, 0.0)
    for run, goal_id in ((7, ONE), (8, TWO)):
        assert keeper.start(run, goal_id, {}, 0.1) == []
    assert keeper.tick(29.0) == [AskLife()]
    ended = [e for e in keeper.tick(30.2) if isinstance(e, RunEnded)]
    assert ended == [RunEnded(run, "absent", "has not been found", {}) for run in (7, 8)]
    assert keeper.is_clear


def test_a_goal_that_is_cancelled_ends_when_the_server_has_stopped() -> None:
    keeper = accepted()
    assert keeper.cancel(7, 0.2) == [CancelGoal(ONE)]
    # The next one waits for it.
    assert keeper.start(8, TWO, {}, 0.3) == []
    assert keeper.cancel_answered(ONE, 0, 0.3) == []
    ended = keeper.result(ONE, CANCELED, "", {}, 0.4)
    assert ended == [RunEnded(7, "cancelled", "", {}), SendGoal(8, TWO, {})]


def test_a_cancellation_that_comes_before_its_goal() -> None:
    keeper = ready()
    keeper.start(7, ONE, {}, 0.1)
    assert keeper.cancel(7, 0.1) == [CancelGoal(ONE)]
    assert keeper.cancel_answered(ONE, UNKNOWN_GOAL, 0.2) == []
    assert not keeper.is_clear
    assert keeper.answered(ONE, True, 0.3) == [AskResult(ONE)]
    effects = keeper.heard(0.2 + AGAIN_S)
    assert effects == [CancelGoal(ONE)]
    assert keeper.cancel_answered(ONE, TERMINATED, 1.4) == [AskResult(ONE)]
    assert keeper.result(ONE, CANCELED, "", {}, 1.5) == [RunEnded(7, "cancelled", "", {})]
    assert keeper.is_clear


def test_a_goal_that_takes_its_time_to_stop_has_not_ended() -> None:
    """A server answers that it cannot cancel once more what it is cancelling."""
    keeper = accepted()
    keeper.cancel(7, 0.2)
    assert keeper.cancel_answered(ONE, 0, 0.3) == []
    assert keeper.start(8, TWO, {}, 0.4) == []
    asked = []
    for now_s in map(float, range(2, 10)):
        assert CancelGoal(ONE) in keeper.heard(now_s)
        asked += [now_s] if keeper.cancel_answered(ONE, TERMINATED, now_s) else []
    # The result may be lost, so it is asked for again.
    assert asked == [2, 3, 5, 9]
    ended = keeper.result(ONE, CANCELED, "", {}, 9.1)
    assert ended == [RunEnded(7, "cancelled", "", {}), SendGoal(8, TWO, {})]


def test_a_cancelled_goal_that_succeeds_all_the_same_says_so() -> None:
    keeper = accepted()
    keeper.cancel(7, 0.2)
    ended = keeper.result(ONE, SUCCEEDED, "fine", {"n": 3}, 0.4)
    assert ended == [RunEnded(7, "succeeded", "fine", {"n": 3})]


def test_a_server_that_does_not_stop_is_no_use_until_it_has() -> None:
    keeper = accepted()
    keeper.cancel(7, 0.2)
    told = [e for e in keeper.heard(0.2 + OBEY_S) if isinstance(e, ServerTold)]
    assert told == [ServerTold(False, "does not stop its cancelled goal")]
    ended = keeper.result(ONE, SUCCEEDED, "", {}, 20.0)
    assert ended[-2:] == [RunEnded(7, "succeeded", "", {}), ServerTold(True, "")]


def test_a_silent_server_is_asked_then_lost_and_asked_for_the_goal_when_it_is_back() -> None:
    keeper = accepted(0.0)
    effects = [e for tick in range(1, 21) for e in keeper.tick(tick * 0.05)]
    assert effects.count(AskLife()) >= 3
    assert effects[-1] == SILENT
    # It stood still and goes on, or it is another process that knows nothing of the goal.
    assert keeper.heard(5.0) == [AskResult(ONE), ServerTold(True, "")]
    assert keeper.result(ONE, UNKNOWN, "", {}, 5.1) == [RunEnded(7, "lost", "", {})]


def test_what_was_cancelled_while_the_server_was_silent_is_cancelled_before_it_is_of_use() -> None:
    keeper = accepted(0.0)
    for tick in range(1, 25):
        keeper.tick(tick * 0.05)
    assert keeper.cancel(7, 1.3) == []
    assert keeper.heard(2.0) == [CancelGoal(ONE)]
    ended = keeper.cancel_answered(ONE, UNKNOWN_GOAL, 2.1)
    assert ended == [RunEnded(7, "cancelled", "", {}), ServerTold(True, "")]


def test_another_process_under_the_same_name_is_asked_for_the_goal() -> None:
    keeper = accepted()
    assert keeper.servers(frozenset({b"a"}), 0.2) == []
    assert keeper.servers(frozenset({b"a"}), 0.3) == []
    assert keeper.servers(frozenset({b"a", b"b"}), 0.4) == [AskResult(ONE)]


def test_answers_that_are_lost_are_asked_for_again() -> None:
    keeper = ready()
    keeper.start(7, ONE, {}, 0.0)
    asked = [now for now in range(1, 100) if AskResult(ONE) in keeper.heard(float(now))]
    assert asked == [5, 15, 35, 75]
    keeper = accepted(0.0)
    asked = [now for now in range(1, 200) if AskResult(ONE) in keeper.heard(float(now))]
    assert asked == [5, 15, 35, 75, 135, 195]
    assert keeper.result(ONE, SUCCEEDED, "", {}, 200.0) == [RunEnded(7, "succeeded", "", {})]


def test_a_server_may_think_before_it_takes_a_goal() -> None:
    keeper = ready()
    keeper.start(7, ONE, {}, 0.0)
    keeper.heard(5.0)
    assert keeper.result(ONE, UNKNOWN, "", {}, 5.1) == []
    assert keeper.answered(ONE, True, 12.0) == [AskResult(ONE)]
    assert keeper.result(ONE, SUCCEEDED, "", {}, 13.0) == [RunEnded(7, "succeeded", "", {})]
    keeper.start(8, TWO, {}, 20.0)
    keeper.heard(20.0 + ACCEPT_S)
    ended = keeper.result(TWO, UNKNOWN, "", {}, 20.0 + ACCEPT_S)
    assert ended == [RunEnded(8, "lost", "", {})]


def test_feedback_shows_that_a_goal_was_taken() -> None:
    keeper = ready()
    keeper.start(7, ONE, {}, 0.0)
    assert keeper.fed_back(ONE, 1.0) == [AskResult(ONE)]
    assert keeper.fed_back(ONE, 1.1) == []
    assert keeper.result(ONE, UNKNOWN, "", {}, 2.0) == [RunEnded(7, "lost", "", {})]


def test_the_second_task_of_a_server_waits_for_the_first() -> None:
    keeper = accepted()
    assert keeper.start(8, TWO, {}, 0.2) == []
    assert keeper.start(9, THREE, {}, 0.2) == []
    assert keeper.cancel(9, 0.3) == [RunEnded(9, "cancelled", "", {})]
    ended = keeper.result(ONE, SUCCEEDED, "", {}, 0.5)
    assert ended == [RunEnded(7, "succeeded", "", {}), SendGoal(8, TWO, {})]
    assert keeper.cancel(8, 0.6) == [CancelGoal(TWO)]


def test_several_servers_under_one_name_are_no_use() -> None:
    two, one = frozenset({b"a", b"b"}), frozenset({b"a"})
    keeper = GoalKeeper(1.0, 0.0)
    keeper.servers(two, 0.0)
    told = ServerTold(False, "is 2 servers that would all take a goal: give them namespaces")
    assert keeper.heard(0.1) == [told]
    assert keeper.start(7, ONE, {}, 0.2) == []
    keeper.servers(one, 0.3)
    assert keeper.heard(0.4) == [SendGoal(7, ONE, {}), ServerTold(True, "")]
    # One that was killed is listed for a while beside its successor.
    keeper.servers(two, 3.0)
    assert told not in keeper.heard(2.9 + LISTED_S)
    assert told in keeper.heard(3.0 + LISTED_S)


def test_servers_that_have_crashed_are_not_counted() -> None:
    """Each one is listed for a while after its end."""
    keeper, names = GoalKeeper(1.0, 0.0), [bytes([i]) for i in range(20)]
    for number in range(20):
        keeper.servers(frozenset(names[max(0, number - 2) : number + 1]), 10.0 * number)
        told = [e for e in keeper.heard(10.0 * number) if isinstance(e, ServerTold)]
        assert told == ([ServerTold(True, "")] if number == 0 else [])


def test_a_server_that_is_not_listed_any_more_has_ended() -> None:
    keeper = accepted(0.0)
    keeper.servers(frozenset({b"a"}), 0.0)
    effects = [e for tick in range(1, 21) for e in keeper.tick(tick * 0.05)]
    assert effects[-1] == SILENT
    assert keeper.servers(frozenset(), 20.0) == [ServerTold(False, "has ended")]
    assert keeper.tick(20.1) == [AskLife()]


def test_goals_of_an_earlier_bridge_are_cancelled_first() -> None:
    keeper = GoalKeeper(1.0, 0.0)
    assert keeper.forget(7, ONE, 0.0) == []
    assert keeper.heard(0.1) == [CancelGoal(ONE)]
    assert keeper.cancel_answered(ONE, 0, 0.2) == []
    ended = keeper.cancel_answered(ONE, UNKNOWN_GOAL, 0.9)
    assert ended == [RunEnded(7, "cancelled", "", {}), ServerTold(True, "")]


def test_one_that_says_it_cannot_be_used() -> None:
    keeper = ready()
    assert keeper.unusable("/A1/nav is inactive") == [ServerTold(False, "/A1/nav is inactive")]
    assert keeper.unusable("/A1/nav is inactive") == []
    assert keeper.heard(1.0) == [ServerTold(True, "")]


class Servers(RuleBasedStateMachine):
    """A server that may be killed, be started again, lose what is sent to it, and take its time.

    Whatever happens: a run ends once at most, there is one goal at work at most, and what nobody
    wants is cancelled; and with a server that answers everything comes to its end.
    """

    @initialize()
    def begin(self) -> None:
        self.now_s = 0.0
        self.keeper = GoalKeeper(1.0, 0.0)
        self.is_alive = True
        self.process = 1
        self.working: set[bytes] = set()
        # Those of them that are being cancelled, and have not stopped.
        self.stopping: set[bytes] = set()
        self.is_slow = False
        self.ended_at_server: dict[bytes, int] = {}
        self.awaited: set[bytes] = set()
        self.goal_of: dict[int, bytes] = {}
        self.wanted: set[int] = set()
        self.is_deaf = False
        self.ends: dict[int, str] = {}
        self.is_up, self.told = False, (False, "has not been found")
        self.count = 0
        self.mail: list[ServerEffect] = []
        self.sent: list[tuple[SendGoal, float]] = []
        self.deliver(AskLife())

    def take(self, effects: Iterable[ServerEffect]) -> None:
        for effect in effects:
            if isinstance(effect, RunEnded):
                assert effect.run not in self.ends
                self.ends[effect.run] = effect.how
                self.wanted.discard(effect.run)
            elif isinstance(effect, ServerTold):
                assert (effect.is_up, effect.why) != self.told
                self.is_up, self.told = effect.is_up, (effect.is_up, effect.why)
            else:
                if isinstance(effect, SendGoal):
                    # One at a time, and only what is wanted.
                    assert self.goal_of[effect.run] == effect.goal_id
                    assert effect.run in self.wanted
                    self.sent.append((effect, self.now_s))
                if not isinstance(effect, AskLife) or effect not in self.mail:
                    self.mail.append(effect)

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            self.take(self.keeper.tick(self.now_s))
            late = [sent for sent, at_s in self.sent if self.now_s - at_s >= ARRIVES_S]
            for goal in [effect for effect in self.mail if effect in late]:
                self.mail.remove(goal)
                self.deliver(goal)

    def deliver(self, effect: ServerEffect) -> None:
        """What a server that is alive does with what is sent to it."""
        if not self.is_alive:
            return
        keeper, now_s = self.keeper, self.now_s
        if isinstance(effect, SendGoal):
            # What came too late is cancelled, but nothing else is begun beside it.
            self.working.add(effect.goal_id)
            if not self.is_deaf:
                self.take(keeper.answered(effect.goal_id, True, now_s))
        elif isinstance(effect, CancelGoal):
            goal_id = effect.goal_id
            if goal_id in self.stopping:
                self.take(keeper.cancel_answered(goal_id, TERMINATED, now_s))
            elif goal_id in self.working:
                self.stopping.add(goal_id)
                self.take(keeper.cancel_answered(goal_id, 0, now_s))
                if not self.is_slow:
                    self.finish(goal_id, CANCELED)
            else:
                known = goal_id in self.ended_at_server
                code = TERMINATED if known else UNKNOWN_GOAL
                self.take(keeper.cancel_answered(goal_id, code, now_s))
        elif isinstance(effect, AskResult):
            goal_id = effect.goal_id
            if goal_id in self.working:
                self.awaited.add(goal_id)
            else:
                status = self.ended_at_server.get(goal_id, UNKNOWN)
                self.result(goal_id, status)
        elif isinstance(effect, AskLife):
            # What the middleware calls it is looked up whenever it is asked.
            self.take(keeper.servers(frozenset({self.process.to_bytes(4, "big")}), now_s))
            self.take(keeper.heard(now_s))

    def finish(self, goal_id: bytes, status: int) -> None:
        self.working.discard(goal_id)
        self.stopping.discard(goal_id)
        self.ended_at_server[goal_id] = status
        if goal_id in self.awaited:
            self.awaited.discard(goal_id)
            self.result(goal_id, status)

    def result(self, goal_id: bytes, status: int) -> None:
        if not self.is_deaf:
            self.take(self.keeper.result(goal_id, status, "", {}, self.now_s))

    @rule(is_deaf=st.booleans())
    def lose_answers(self, is_deaf: bool) -> None:
        """Answers about goals are lost from now on, or no longer."""
        self.is_deaf = is_deaf

    @rule(is_slow=st.booleans())
    def stop_slowly(self, is_slow: bool) -> None:
        """Cancelled goals go on from now on until their work is done, or no longer."""
        self.is_slow = is_slow

    @rule()
    def start(self) -> None:
        if len(self.wanted) < 2:
            self.count += 1
            self.wanted.add(self.count)
            self.goal_of[self.count] = self.count.to_bytes(16, "big")
            self.take(self.keeper.start(self.count, self.goal_of[self.count], {}, self.now_s))

    @precondition(lambda self: self.wanted)
    @rule(data=st.data())
    def cancel(self, data: st.DataObject) -> None:
        run = data.draw(st.sampled_from(sorted(self.wanted)))
        self.wanted.discard(run)
        self.take(self.keeper.cancel(run, self.now_s))

    @precondition(lambda self: self.mail)
    @rule(data=st.data(), lost=st.sampled_from([False, False, True]))
    def post(self, data: st.DataObject, lost: bool) -> None:
        """One of the messages under way arrives, or is lost."""
        effect = self.mail.pop(data.draw(st.integers(0, len(self.mail) - 1)))
        # Goals are sent reliably: they arrive, or the server has died.
        if not lost or isinstance(effect, SendGoal | AskResult):
            self.deliver(effect)

    @rule(status=st.sampled_from([SUCCEEDED, ABORTED]))
    def work_is_done(self, status: int) -> None:
        if self.is_alive and self.working:
            self.finish(min(self.working), status)

    @rule()
    def kill(self) -> None:
        """And what was on its way to it is lost."""
        self.is_alive = False
        self.process += 1
        self.working.clear()
        self.stopping.clear()
        self.awaited.clear()
        self.ended_at_server.clear()
        self.mail.clear()

    @rule()
    def start_again(self) -> None:
        self.is_alive = True

    @rule(seconds=st.sampled_from([0.1, 0.5, 1.5, 4.0]))
    def wait(self, seconds: float) -> None:
        self.pass_time(seconds)

    @invariant()
    def one_goal_at_a_time(self) -> None:
        assert len(self.working) <= 1

    def teardown(self) -> None:
        """With a server that answers, all that is not wanted stops, and what is wanted ends."""
        if not hasattr(self, "keeper"):
            return
        self.is_alive, self.is_deaf, self.is_slow = True, False, False
        for goal_id in list(self.stopping):
            self.finish(goal_id, CANCELED)
        for _ in range(3):
            for _ in range(700):
                self.pass_time(0.1)
                while self.mail:
                    self.deliver(self.mail.pop(0))
            assert self.is_up
            assert self.working <= {self.goal_of[run] for run in self.wanted}
            for goal_id in list(self.working):
                self.finish(goal_id, SUCCEEDED)
        assert self.keeper.is_clear
        assert set(self.ends) == set(self.goal_of)


TestServers = Servers.TestCase
TestServers.settings = settings(stateful_step_count=60, deadline=None)
