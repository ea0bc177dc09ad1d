"""Random conversations: whatever happened, a healed team comes to agree and to finish."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.bt.tree import Status
from tests.support.effort import at_size
from tests.support.script import Script

ROBOTS = ("A", "B", "C")
PAIRS = ("A B", "A C", "B C")
TEAM = """
robot A look weld*0.9
robot B look*0.8 weld lift
robot C lift look*0.5
task cover lift 2..2
task check look 1..2
task repair weld
tree Sequence("cover", Parallel(2, Retry(3, "check"), Fallback("?sound", "repair")), "close")
task close look
start A B C
pass 100
"""

commands = st.one_of(
    st.integers(1, 1_500).map(lambda ms: f"pass {ms}"),
    st.sampled_from(ROBOTS).flatmap(
        lambda robot: st.sampled_from(
            [
                f"succeed {robot} sound=false",
                f"succeed {robot}",
                f"fail {robot} sound=true",
                f"kill {robot}",
                f"start {robot}",
                f"freeze {robot}",
                f"thaw {robot}",
                f"stop_slowly {robot}",
                f"set {robot} sound=true",
                f"set {robot} sound=false",
                f"tell {robot} fault look",
                f"tell {robot} restore all",
                f"operate {robot} paused pause",
                f"operate {robot} paused resume",
            ]
        )
    ),
    st.sampled_from(PAIRS).flatmap(lambda pair: st.sampled_from([f"cut {pair}", f"mend {pair}"])),
)


def fits(script: Script, command: str) -> bool:
    """Whether a command makes sense now."""
    word, *names = command.split()
    process = script.team.processes.get(names[0])
    match word:
        case "pass" | "cut" | "mend":
            return True
        case "start":
            return process is None
        case "succeed" | "fail":
            return process is not None and bool(process.tickets) and not process.frozen
    return process is not None


def heal(script: Script) -> None:
    """Take every fault back."""
    lines = [f"mend {pair}" for pair in PAIRS]
    for robot in ROBOTS:
        process = script.team.processes.get(robot)
        if process is None:
            lines.append(f"start {robot}")
        elif process.frozen:
            lines.append(f"thaw {robot}")
    script.block(lines)
    for process in script.team.processes.values():
        process.stops_at_once = True
        action = process.agent.view.action
        for number in list(process.tickets):
            if action is None or action.ticket != number or process.agent.view.claim is None:
                script.block([f"stopped {process.name}"])
    script.block(["pass 3000", "operate A paused resume"])
    script.block([f"tell {robot} restore all" for robot in ROBOTS])
    script.block(["pass 3000"])


def agents(script: Script) -> list[Agent]:
    return [script.team.processes[robot].agent for robot in ROBOTS]


def assert_agreement(script: Script) -> None:
    first, *others = (agent.view for agent in agents(script))
    assert first.plan is not None
    for other in others:
        assert other.plan is not None
        assert other.facts.map.digest() == first.facts.map.digest()
        assert other.plan.packed == first.plan.packed


@settings(max_examples=at_size(quick=20, gate=60))
@given(st.lists(commands, max_size=25))
def test_a_healed_team_agrees_and_finishes(history: list[str]) -> None:
    script = Script()
    script.block(TEAM.strip().splitlines())
    for command in history:
        if fits(script, command):
            script.block([command])
    heal(script)
    assert_agreement(script)
    for _ in range(20):
        for process in list(script.team.processes.values()):
            if process.tickets:
                script.block([f"succeed {process.name}"])
        script.block(["pass 400"])
        assert_agreement(script)
    results = [agent.view.plan.result for agent in agents(script) if agent.view.plan is not None]
    # A task may have failed for good: then everybody says so. Nobody waits for ever.
    assert results in ([Status.SUCCESS] * 3, [Status.FAILURE] * 3)
    assert not any(process.tickets for process in script.team.processes.values())
