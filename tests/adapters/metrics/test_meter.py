"""What is counted of a robot, from what goes into its agent and comes out."""

from __future__ import annotations

from mrbt_mesh.adapters.metrics.families import OTHER
from mrbt_mesh.adapters.metrics.meter import Meter
from mrbt_mesh.core.agent.effects import Log, Persist, Reply
from mrbt_mesh.core.agent.inputs import AnswerReceived, InputBatch, MessageReceived, QueryReceived
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.engine import FASTEST
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.wire import MessageKind
from tests.support.build import RUN, action, make_mission, sequence
from tests.support.metered import MeteredTeam

MISSION = make_mission(sequence(action("weld")), {"A": {"weld": 1}, "B": {"weld": 1}})
BEAT = MessageReceived(MessageKind.HEARTBEAT, "B", b"12345")


def meter() -> Meter:
    return Meter("A", MISSION)


def test_messages_are_counted_one_by_one_also_those_that_waited_together() -> None:
    found = meter()
    found.take(InputBatch((BEAT, MessageReceived(MessageKind.FACT, "B", b"1"))))
    found.take(BEAT)
    found.take(QueryReceived(1, MessageKind.PULL, b"123"))
    found.take(AnswerReceived("B", b"1234"))
    found.take(AnswerReceived("B", None))
    assert found.received.messages == {"heartbeat": 2, "fact": 1, "pull": 1, "reply": 1}
    assert found.received.bytes == {"heartbeat": 10, "fact": 1, "pull": 3, "reply": 4}
    found.carry_out(Reply(1, (b"12", b"3")))
    assert (found.sent.messages, found.sent.bytes) == ({"reply": 2}, {"reply": 3})


def test_its_work_and_what_it_says_of_others() -> None:
    team = MeteredTeam("succeed A", "pass 300", "kill B", "pass 2000")
    found = team.meter
    assert found.claims["weld", "running"] == 1
    assert found.outcomes == {("weld", "success"): 1}
    assert (found.suspicions["B"], found.deaths["B"]) == (1, 1)
    assert found.sent.messages["heartbeat"] > 10 < found.received.messages["heartbeat"]
    assert found.fencings == 0


def test_a_robot_that_was_frozen_fences_itself() -> None:
    team = MeteredTeam("freeze A", "pass 3000", "thaw A", "pass 500")
    assert team.meter.fencings == 1


def test_names_that_the_mission_lacks_get_no_label_of_their_own() -> None:
    found = meter()
    for number in range(100):
        found.carry_out(Log("warning", "robot_dead", {"robot": f"X{number}"}))
        version = Version(Incarnation(1, "n"), number + 1)
        name = f"outcome/{number}~weird/strange({number})"
        found.carry_out(Persist((parse_entry("B", name, version, [True, None]),), True))
    assert found.deaths == {OTHER: 100}
    assert found.outcomes == {}, "the others' outcomes are theirs to count"


def test_each_plan_is_timed_and_is_the_same_plan() -> None:
    found = meter()
    facts, alive = TeamFacts(MISSION, RUN), {"A": Incarnation(1, "n")}
    engine = found.timed(FASTEST)
    for _ in range(3):
        plan = engine.plan_making(default_solver)(facts, alive)
        plain = FASTEST.plan_making(default_solver)(facts, alive)
        assert plan.packed == plain.packed
    assert sum(found.plan_s.counts) == 3
    assert found.plan_s.sum_s > 0


def test_since_when_all_agree_is_kept_until_that_changes() -> None:
    found = meter()
    found.look(-0.1, agrees=True)
    first = found.agreed_since_s
    found.look(0.2, agrees=True)
    assert found.agreed_since_s == first
    found.look(0.2, agrees=False)
    assert found.agreed_since_s > first
    assert [count for count in found.lag_s.counts if count] == [1, 2]
