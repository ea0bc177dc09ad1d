"""What an agent must never do, whatever it is given. The conversations are in `scripts/`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.agent import effects as fx
from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.facts.records import TeamOrder
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import (
    MAX_TREE_NODES,
    Header,
    Heartbeat,
    MessageKind,
    SelfReport,
    Suspicion,
    encode,
    pack_heartbeat,
)
from tests.support import harness, inside
from tests.support.commands import command
from tests.support.harness import MS
from tests.support.plain_data import mutations, plain
from tests.support.script import Script

TEAM = """
robot A weld
robot B look
tree Sequence("weld", Fallback("?sound", "look"))
start A B
"""


def team(text: str = TEAM) -> Script:
    script = Script()
    script.block(text.strip().splitlines())
    return script


def story(script: Script, *commands: str) -> str:
    return script.block(list(commands))


def header(script: Script, sender: str = "B") -> Header:
    mine = script.team.processes["A"].agent.view.header
    return Header(mine.mission, mine.mission_name, mine.run, sender)


# -- whatever arrives -------------------------------------------------------------------------


def give(script: Script, event: inputs.Input) -> None:
    script.team.give(script.team.processes["A"], event)


@st.composite
def any_input(draw: st.DrawFn, mine: Header) -> inputs.Input:
    """Anything that the network could bring, from noise to almost correct messages."""
    kind = draw(st.sampled_from(MessageKind))
    entry = ["B", 1, "n2", 9, [["claim", ["r1:1:weld::0", "weld", "weld", 3, 5, ""]]]]
    report, relays = [1, "n2", 9, 1, b"p" * 8], [["A", 1, "n1", 9, b"p" * 8]]
    beat = [*report, b"f" * 8, [1, 2, 1, 1], 1, 0, [], relays]
    body: Any = draw(plain | mutations([entry]) | mutations(beat) | mutations(["team", "pause"]))
    data = draw(st.binary(max_size=60) | st.just(encode(mine, kind, body)))
    sources = st.sampled_from(("A", "B", "Z"))
    return draw(
        st.one_of(
            st.builds(inputs.MessageReceived, st.just(kind), sources, st.just(data)),
            st.builds(inputs.QueryReceived, st.just(0), st.just(kind), st.just(data)),
            st.builds(inputs.AnswerReceived, sources, st.just(data) | st.none()),
            st.builds(
                inputs.TokenChanged,
                sources,
                st.builds(Incarnation, st.integers(0, 3), st.just("n2")),
                st.booleans(),
            ),
        )
    )


@given(st.data())
def test_nothing_that_arrives_stops_an_agent_or_reaches_another_robots_facts(
    data: st.DataObject,
) -> None:
    script = team()
    robot = script.team.processes["A"]
    before = {(e.name, e.version) for e in robot.agent.view.facts.map.of_author("A")}
    for event in data.draw(st.lists(any_input(header(script)), max_size=5)):
        # An answer to a command is no story here, and a real command may well stop the robot.
        robot.agent.handle(event, script.team.now_us)
    after = {(e.name, e.version) for e in robot.agent.view.facts.map.of_author("A")}
    assert {name for name, _ in before} <= {name for name, _ in after}
    robot.agent.handle(inputs.TimerFired(), script.team.now_us + 50 * MS)


def test_a_robot_cannot_publish_for_another_one() -> None:
    script = team()
    forged = [["A", 9, "zz", 1, [["claim", None]], None]]
    data = encode(header(script), MessageKind.FACT, forged)
    give(script, inputs.MessageReceived(MessageKind.FACT, "B", data))
    assert "B published entries of another author" in script.team.story[-1]
    assert script.team.processes["A"].agent.view.facts.valid_claim("A") is not None


def test_a_message_under_the_key_of_another_robot_is_refused() -> None:
    script = team()
    for kind in (MessageKind.HEARTBEAT, MessageKind.FACT):
        data = encode(header(script, "C"), kind, [])
        give(script, inputs.MessageReceived(kind, "B", data))
    refusals = script.team.processes["A"].agent.view.refused
    assert refusals == {"B: sender C published under the key of B": 2}


def test_what_is_refused_is_counted_and_logged_once() -> None:
    script = team()
    agent = script.team.processes["A"].agent
    for _ in range(5):
        give(script, inputs.MessageReceived(MessageKind.HEARTBEAT, "B", b"noise"))
    told = [line for line in script.team.story if "input_refused" in line]
    assert len(told) == 1
    assert sum(agent.view.refused.values()) == 5


def test_refusals_do_not_fill_the_memory() -> None:
    script = team()
    agent = script.team.processes["A"].agent
    for number in range(2_000):
        data = encode(header(script, f"Z{number}"), MessageKind.HEARTBEAT, [])
        agent.handle(inputs.MessageReceived(MessageKind.HEARTBEAT, "B", data), script.team.now_us)
    assert len(agent.view.refused) == 1_001
    assert sum(agent.view.refused.values()) == 2_000
    assert agent.view.refused["others: too many to tell apart"] == 1_000


@pytest.mark.parametrize("body", [None, [], ["leave"], ["leave", 1], ["leave", "x" * 5_000], {}])
def test_a_malformed_command_is_answered_and_changes_nothing(body: Any) -> None:
    script = team()
    data = encode(header(script, ""), MessageKind.COMMAND, body)
    give(script, inputs.QueryReceived(0, MessageKind.COMMAND, data))
    assert "A answers no: a command is a list of a text and its argument" in script.team.story[-1]


# -- the robot's own code ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "event",
    [
        inputs.ActionFinished(99, True),
        inputs.ActionStopped(99),
        inputs.ProgressReported(99, 50),
        inputs.TreeTicked(99, b"\1"),
        inputs.ConditionSet("nonsense", True),
    ],
)
def test_reports_about_unknown_actions_and_conditions_change_nothing(event: inputs.Input) -> None:
    script = team()
    facts = script.team.processes["A"].agent.view.facts
    before = facts.map.digest()
    give(script, event)
    assert facts.map.digest() == before


@pytest.mark.parametrize(("reported", "shown"), [(-5, 0), (40, 40), (400, 100)])
def test_progress_is_shown_in_percent(reported: int, shown: int) -> None:
    script = team()
    robot = script.team.processes["A"]
    give(script, inputs.ProgressReported(robot.tickets[-1], reported))
    assert inside.context(robot.agent).work.progress == shown


def test_the_statuses_of_the_tree_that_runs_go_when_its_action_does() -> None:
    script = team()
    robot = script.team.processes["A"]
    work = inside.context(robot.agent).work
    give(script, inputs.TreeTicked(robot.tickets[-1] + 1, b"\3"))
    assert work.tree_statuses == b""
    give(script, inputs.TreeTicked(robot.tickets[-1], b"\1\2\0"))
    assert work.tree_statuses == b"\1\2\0"
    give(script, inputs.TreeTicked(robot.tickets[-1], bytes(MAX_TREE_NODES + 1)))
    assert work.tree_statuses == b"", "too many to be told"
    give(script, inputs.TreeTicked(robot.tickets[-1], b"\1"))
    script.team.give(robot, inputs.ActionFinished(robot.tickets.pop(), True))
    assert work.tree_statuses == b""


# -- time and ends ----------------------------------------------------------------------------


def test_an_agent_that_has_stopped_does_nothing_more() -> None:
    script = team()
    robot = script.team.processes["B"]
    effects = robot.agent.handle(inputs.LeaveRequested(), script.team.now_us)
    assert isinstance(effects[-1], fx.Stop)
    assert robot.agent.handle(inputs.TimerFired(), script.team.now_us + 500 * MS) == []


@pytest.mark.parametrize(
    "commands",
    [
        ["leave A"],
        ["start A2=A takeover", "pass 1100"],
        ["tell A leave"],
    ],
)
def test_stopping_is_the_last_thing_that_an_agent_does(commands: list[str]) -> None:
    told = story(team(), *commands).splitlines()
    of_a = [line for line in told if line[6:].startswith("A ")]
    assert "stops with" in of_a[-1]


@given(st.lists(st.integers(1, 400), max_size=20))
def test_the_next_deadline_lies_ahead_and_within_one_beat(pauses: list[int]) -> None:
    script = team()
    for pause in pauses:
        script.team.pass_time(pause)
        for process in script.team.processes.values():
            now_us = script.team.now_us
            due_us = process.agent.next_deadline_us(now_us)
            assert now_us < due_us <= now_us + 100 * MS


def test_a_quiet_team_only_beats() -> None:
    script = team()
    script.team.pass_time(200)
    agents = [process.agent for process in script.team.processes.values()]
    before = [len(agent.view.facts.map) for agent in agents], agents[0].view.facts.changes
    assert story(script, "pass 5000") == "ok"
    assert ([len(agent.view.facts.map) for agent in agents], agents[0].view.facts.changes) == before


def test_both_robots_hold_the_same_bytes_after_a_conversation() -> None:
    script = team()
    story(script, "cut A B", "succeed A sound=false", "set B sound=true", "pass 400", "mend A B")
    story(script, "pass 1500")
    first, second = (process.agent for process in script.team.processes.values())
    assert first.view.facts.map.digest() == second.view.facts.map.digest()
    assert first.view.plan is not None
    assert second.view.plan is not None
    assert first.view.plan.packed == second.view.plan.packed


@pytest.mark.parametrize("size", [0, 3, 1 << 16])
def test_an_answer_of_any_size_that_is_noise_is_refused(size: int) -> None:
    script = team()
    give(script, inputs.AnswerReceived("B", msgpack.packb(b"x" * size)))
    assert "not a message of this protocol" in script.team.story[-1]


# -- before it has joined ---------------------------------------------------------------------


def started_again(before: Agent, knows_its_past: bool, now_us: int) -> Agent:
    """The same robot in another process, which is about to join; B is expected."""
    kept = tuple(before.view.facts.map) if knows_its_past else ()
    config = replace(
        inside.context(before).config, nonce="later", restored=kept, expected=frozenset({"B"})
    )
    return Agent(before.view.mission, config, now_us)


@pytest.mark.parametrize("knows_its_past", [True, False])
def test_what_a_robot_says_while_it_joins_is_written_once_it_has(knows_its_past: bool) -> None:
    """Before, an entry of an earlier life, which has a higher incarnation, would stand."""
    script = team()
    story(script, "pass 200")
    before = script.team.processes["A"].agent
    now_us = 300 * MS
    before.handle(inputs.ConditionSet("sound", True), now_us)
    agent = started_again(before, knows_its_past, now_us)
    for value in (knows_its_past, not knows_its_past):
        agent.handle(inputs.ConditionSet("sound", value), now_us)
    inside.command(agent, TeamOrder.PAUSE, now_us)
    assert agent.view.facts.order() is TeamOrder.RESUME, "it is still joining"
    assert all(entry.version.incarnation.counter for entry in agent.view.facts.map.of_author("A"))
    agent.handle(inputs.TimerFired(), now_us + 60_000 * MS)
    assert not agent.view.is_joining
    assert agent.view.facts.condition("sound") is not knows_its_past
    mine = {entry.name: entry.version for entry in agent.view.facts.map.of_author("A")}
    assert mine["condition/sound"].incarnation == agent.view.incarnation


def test_a_borrowed_robot_stays_so_in_its_next_life_until_it_is_returned() -> None:
    script = team()
    story(script, "pass 200", "operate A borrowed/A at_once", "pass 200")
    before, now_us = script.team.processes["A"].agent, 600 * MS
    agent = started_again(before, True, now_us)
    agent.handle(inputs.TimerFired(), now_us + 60_000 * MS)
    assert agent.view.facts.members["A"].member.pending == {"weld": "borrowed by op"}
    returned = command("borrowed/A", "returned", 99, "r")
    inside.context(agent).replica.facts.map.merge([returned])
    agent.handle(inputs.TimerFired(), now_us + 60_100 * MS)
    assert agent.view.facts.members["A"].member.pending == {}


# -- earlier lives ----------------------------------------------------------------------------


def test_a_life_that_begins_by_self_fencing_is_on_disk_before_anybody_hears_of_it() -> None:
    """Otherwise the next process of this robot might take the same incarnation again."""
    script = team()
    story(script, "pass 200")
    agent = script.team.processes["A"].agent
    before = agent.view.incarnation
    effects = agent.handle(inputs.TimerFired(), 60_000 * MS)
    assert agent.view.incarnation > before
    synced = [effect for effect in effects if isinstance(effect, fx.Persist) and effect.at_once]
    assert any(e.version.incarnation == agent.view.incarnation for p in synced for e in p.entries)
    told = next(
        effect
        for effect in effects
        if isinstance(effect, fx.Publish) and effect.kind is MessageKind.HEARTBEAT
    )
    assert effects.index(synced[0]) < effects.index(told)


@pytest.mark.parametrize(("ahead", "nonce"), [(0, "zzz"), (3, "zz")])
def test_a_robot_whose_later_life_others_bury_joins_above_it(ahead: int, nonce: str) -> None:
    """They ignore its heartbeats. The suspicion alone changes no peer, no fact and no deadline."""
    script = team()
    story(script, "pass 1000")
    agent = script.team.processes["A"].agent
    later = Incarnation(agent.view.incarnation.counter + ahead, nonce)
    assert later > agent.view.incarnation
    peer = agent.view.peers["B"]
    beat = Heartbeat(
        SelfReport(peer.incarnation, peer.report.number + 1, peer.report.plan_digest, True, 1),
        False,
        agent.view.facts.map.digest(),
        (1, 2, 1, 1),
        0,
        (Suspicion("A", later, is_token_lost=False, is_dead=True, is_probe=False),),
        {},
    )
    data = encode(header(script), MessageKind.HEARTBEAT, pack_heartbeat(beat))
    received = inputs.MessageReceived(MessageKind.HEARTBEAT, "B", data)
    effects = agent.handle(received, script.team.now_us)
    assert "later_life_found" in [effect.event for effect in effects if isinstance(effect, fx.Log)]
    assert agent.view.is_joining
    agent.handle(inputs.TimerFired(), 60_000 * MS)
    assert not agent.view.is_joining
    assert agent.view.incarnation.counter > later.counter


# -- what costs little ------------------------------------------------------------------------


def settled(script: Script, ms: int) -> tuple[int, int]:
    """(how often the agents settled, how often they beat) while so much time passes."""
    with inside.counted() as counts:
        story(script, f"pass {ms}")
    return counts["followed up"], counts["beats"]


def test_a_team_at_work_beats_and_has_nothing_to_think_of() -> None:
    script = team()
    story(script, "pass 2000")
    steps, beats = settled(script, 4_000)
    beat_us = harness.TIMING.heartbeat_us
    assert beats == 2 * 4_000 * MS // beat_us
    assert steps == 0


@pytest.mark.parametrize("is_joining", [True, False])
def test_what_is_due_before_the_timer_is_set_is_not_put_off(is_joining: bool) -> None:
    """Carrying out effects takes a while: a disk may be slow."""
    script = team(TEAM.replace("start A B", "start A") if is_joining else TEAM)
    agent = script.team.processes["A"].agent
    joining = inside.context(agent).joining
    assert (joining is not None) is is_joining
    due_us = inside.schedule(agent).next_due_us if joining is None else joining.deadline_us
    assert agent.next_deadline_us(due_us + 1) <= due_us


def test_what_a_timer_lets_in_that_has_waited_for_a_plan_is_followed_up() -> None:
    """An action that has stopped frees its robot for the next one, which would never begin."""
    script = team()
    story(script, "pass 2000")
    now_us = script.team.now_us
    for event, expected in ((inputs.ActionStopped(99), 1), (inputs.ProgressReported(99, 1), 0)):
        with inside.counted() as counts:
            taken = [inputs.TimerFired(), event]
            script.team.processes["A"].agent._follow_up(taken, now_us)
        assert counts["followed up"] == expected
