"""T_Li at work: following this robot's line of the plan, from the claim to the action.

A robot starts once the team agrees (`may_start`). Where a coalition carries out the task, it
then is *ready*: the leader starts when enough members are, the others when the leader has
written them down. For an exclusive task each of them also needs the grants of a majority.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.coalitions import is_enough, ready_members, standing_coalition
from mrbt_mesh.core.facts.records import Claim, Coalition, Phase, Token
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.mission.mission import GlobalTask, performance, type_name

if TYPE_CHECKING:
    from mrbt_mesh.core.agent.agent import Agent
    from mrbt_mesh.core.agent.effects import StartAction


def perform(agent: Agent, now_us: int) -> None:
    """Follow the plan; cancel, claim, get ready and start what it says."""
    plan, work = agent.plan, agent.work
    assert plan is not None
    before = work.claim
    line = None if agent.leaving else plan.lines.get(agent.me)
    changed, effects = work.follow(line, agent.replica.stamp(), now_us)
    agent.emit(effects)
    writes = given_up(agent, before) if changed else []
    token: Token | None = None
    is_cleared = work.claim is not None and not work.is_waiting
    if work.is_waiting and _may_start(agent, now_us):
        task = _task(agent)
        if task.by_coalition:
            if work.claim is not None and work.claim.phase is Phase.CLAIMED:
                work.get_ready()
                # The coalition's leader refers to this entry, also if it is this robot.
                agent.write([*writes, _claim_write(agent)], now_us)
                writes, changed = [], False
            token, more = _coalition(agent, task, now_us)
            writes += more
        is_cleared = token is not None or not task.by_coalition
    assigned = type_name(work.claim.local_task) if work.claim is not None else None
    wanted = agent.tree.tick(plan.result, assigned if is_cleared else None)
    if wanted is not None and work.is_waiting and work.claim is not None:
        partners = plan.partners(agent.me)
        coalition = str(token) if token is not None else ""
        declared = performance(agent.config.capabilities, work.claim.local_task)
        assert declared is not None
        start = work.start(partners, declared, agent.replica.incarnation, coalition)
        # The claim is on disk before the action begins.
        agent.write([*writes, _claim_write(agent)], now_us)
        _log_start(agent, start)
    elif changed and work.claim != before:
        agent.write([*writes, _claim_write(agent)], now_us)


def _log_start(agent: Agent, start: StartAction) -> None:
    agent.emit([start])
    agent.log(
        "info",
        "local_task_started",
        global_task=start.global_task,
        local_task=start.local_task,
        activation=start.activation,
    )


def _claim_write(agent: Agent) -> tuple[str, Any]:
    claim = agent.work.claim
    return records.CLAIM, claim.to_value() if claim is not None else None


def _task(agent: Agent) -> GlobalTask:
    assert agent.work.claim is not None
    return agent.mission.global_tasks[agent.work.claim.global_task]


def _may_start(agent: Agent, now_us: int) -> bool:
    """Whether all robots in good standing have the same plan, or the grace time has passed."""
    assert agent.plan is not None
    return agent.membership.agrees(agent.plan.digest) or now_us >= agent.grace_ends_us()


def token_sought(agent: Agent) -> Token | None:
    """The coalition that this robot is ready for, or runs with; None without any."""
    line, claim = agent.work.line, agent.work.claim
    if line is None or claim is None or not line.leader or claim.phase is Phase.CLAIMED:
        return None
    if claim.coalition:
        return Token.parse(claim.coalition)
    if line.leader == agent.me:
        return Token(claim.since, agent.me, *agent.replica.incarnation)
    leaders = agent.facts.valid_claim(line.leader)
    if leaders is None or leaders.activation != line.activation or leaders.phase is Phase.CLAIMED:
        return None
    return Token(leaders.since, line.leader, *agent.facts.members[line.leader][1])


def _coalition(
    agent: Agent, task: GlobalTask, now_us: int
) -> tuple[Token | None, list[tuple[str, Any]]]:
    """The coalition with which this robot may start now, and what to write with it."""
    line, claim = agent.work.line, agent.work.claim
    assert line is not None
    assert claim is not None
    if line.leader != agent.me:
        return _written_down(agent, task, line.activation, claim, now_us), []
    token = token_sought(agent)
    assert token is not None
    assert agent.plan is not None
    if task.exclusive and not agent.grants.holds(line.activation, token, now_us):
        return None, []
    lines = agent.plan.lines.values()
    planned = {x.robot: x.local_task for x in lines if x.activation == line.activation}
    members = ready_members(agent.facts, line.activation, planned)
    if not is_enough(task, members):
        return None, []
    if len(members) < len(planned) and now_us < agent.grace_ends_us():
        return None, []  # the others may be ready in a moment
    name = f"{records.COALITION}/{line.activation}/{token}"
    return token, [(name, Coalition(tuple(members)).to_value())]


def _written_down(
    agent: Agent, task: GlobalTask, activation: str, claim: Claim, now_us: int
) -> Token | None:
    """The standing coalition, if its leader has written down this robot's present claim."""
    found = agent.facts.coalitions(activation)
    token = standing_coalition(agent.facts, task, activation, agent.alive())
    if token is None or (task.exclusive and not agent.grants.holds(activation, token, now_us)):
        return None
    mine = (claim.since, agent.me, agent.replica.incarnation)
    for member in found.members[token]:
        if (member.since, member.robot, Incarnation(member.counter, member.nonce)) == mine:
            return token
    return None


def given_up(agent: Agent, claim: Claim | None) -> list[tuple[str, Any]]:
    """What to say of a claim on an exclusive task that is dropped without an outcome.

    Begun, it leaves the activation in doubt; a leader that never began sets its grants free.
    """
    if claim is None or not agent.mission.global_tasks[claim.global_task].exclusive:
        return []
    activation = claim.activation
    if claim.phase is Phase.RUNNING:
        doubts = agent.facts.coalitions(activation).doubts
        if agent.me in doubts.get(Token.parse(claim.coalition), ()):
            return []
        return [(f"{records.DOUBT}/{activation}/{claim.coalition}", True)]
    token = Token(claim.since, agent.me, *agent.replica.incarnation)
    if agent.grants.seeks == (activation, str(token)):
        return [(f"{records.CLEARED}/{activation}/{token}", True)]
    return []


def seek_grants(agent: Agent) -> None:
    """Ask for the grants that this robot's claim needs."""
    claim = agent.work.claim
    if claim is not None and agent.mission.global_tasks[claim.global_task].exclusive:
        agent.grants.seek(claim.activation, token_sought(agent))
    else:
        agent.grants.seek("", None)


def check_grants(agent: Agent, now_us: int) -> None:
    """Follow the grants that this robot has given; stop where its own have run out."""
    agent.write(agent.grants.step(now_us), now_us)
    claim = agent.work.claim
    if claim is None or claim.phase is not Phase.RUNNING:
        return
    if not agent.mission.global_tasks[claim.global_task].exclusive:
        return
    token = Token.parse(claim.coalition)
    found = agent.facts.coalitions(claim.activation)
    ended = token in found.broken or agent.me in found.doubts.get(token, ())
    if not ended and not agent.grants.holds(claim.activation, token, now_us):
        agent.log("warning", "grants_ran_out", global_task=claim.global_task)
        names = (records.DOUBT, records.BROKEN)
        agent.write([(f"{name}/{claim.activation}/{token}", True) for name in names], now_us)


def may_grant(agent: Agent, activation: str, token: Token) -> bool:
    """Whether this robot's own view speaks for giving `activation` to this coalition."""
    if agent.joining is not None or agent.leaving or agent.plan is None:
        return False
    if agent.facts.coalitions(activation).unended(agent.facts.givers)[:1] == [token]:
        return True
    line = agent.plan.lines.get(token.leader)
    life = (token.counter, token.nonce)
    known = agent.facts.members.get(token.leader)
    return (
        line is not None
        and (line.activation, line.leader) == (activation, token.leader)
        and known is not None
        and known[1] == life
    )
