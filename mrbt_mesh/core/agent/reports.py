"""What a robot tells its team of itself: outcomes, conditions, bids, lost capabilities."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.agent.effects import RequestBid
from mrbt_mesh.core.agent.executor import given_up
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.mission.mission import performance, type_name

if TYPE_CHECKING:
    from mrbt_mesh.core.agent.agent import Agent
    from mrbt_mesh.core.agent.inputs import ActionFinished, BidsMade

CONDITIONS_PER_OUTCOME = 1_000


def finished(agent: Agent, event: ActionFinished, now_us: int) -> None:
    """Write the outcome and the conditions in one batch, with the claim that ends."""
    claimed = agent.work.claim
    action = agent.work.finish(event.ticket)
    if action is None:
        return
    name = f"{records.OUTCOME}/{action.activation}/{action.local_task}"
    if action.coalition:
        name += f"/{action.coalition}"
    writes: list[tuple[str, Any]] = [(name, [event.success, event.data])]
    problem = agent.replica.problem(*writes[0])
    if problem is not None:
        local_task = action.local_task
        agent.log("error", "result_data_refused", local_task=local_task, reason=problem)
        writes = [(name, [event.success, None])]
    writes += _condition_writes(agent, event.conditions)
    if agent.work.claim is None and claimed is not None:
        writes.append((records.CLAIM, None))
    agent.write(writes, now_us)
    agent.log(
        "info" if event.success else "warning",
        "local_task_finished",
        global_task=action.global_task,
        local_task=action.local_task,
        outcome="success" if event.success else "failure",
        error=event.error,
    )


def _condition_writes(
    agent: Agent, conditions: Iterable[tuple[str, bool]]
) -> list[tuple[str, list[Any]]]:
    """The entries that make conditions true or false; none where they are so already."""
    writes: dict[str, list[Any]] = {}
    stamp = agent.replica.stamp()
    for name, value in list(conditions)[:CONDITIONS_PER_OUTCOME]:
        if not agent.mission.knows_condition(name):
            agent.log("error", "condition_not_declared", condition=name)
        elif agent.facts.condition(name) != value:
            revision = agent.facts.revision(name) + 1
            writes[f"{records.CONDITION}/{name}"] = [value, revision, stamp]
        else:
            writes.pop(f"{records.CONDITION}/{name}", None)
    return list(writes.items())


def set_conditions(agent: Agent, values: Mapping[str, bool], now_us: int) -> None:
    """Tell them; a new life keeps them until it has an incarnation above all earlier ones."""
    if agent.is_new:
        known = {n: v for n, v in values.items() if agent.mission.knows_condition(n)}
        agent.unsaid |= known
        values = {n: v for n, v in values.items() if n not in known}
    agent.write(_condition_writes(agent, values.items()), now_us)


def ask_for_bids(agent: Agent) -> None:
    """Have this robot's program bid for what the plan lacks its bids for, once each."""
    assert agent.plan is not None
    if not agent.plan.biddings:
        agent.asked_bids.clear()
        return
    wanted = {
        (bidding.activation, bidding.local_task): bidding.global_task
        for bidding in agent.plan.biddings
        if agent.me in bidding.silent
    }
    fresh = sorted(wanted.keys() - agent.asked_bids)
    agent.asked_bids = set(wanted)
    capabilities, incarnation = agent.config.capabilities, agent.replica.incarnation
    agent.emit(
        RequestBid(activation, wanted[activation, local_task], local_task, declared, incarnation)
        for activation, local_task in fresh
        if (declared := performance(capabilities, local_task)) is not None
    )


def bids_made(agent: Agent, event: BidsMade, now_us: int) -> None:
    """Tell the team, all in one batch. What was asked for before a new life is asked for again."""
    if agent.joining is not None:
        agent.asked_bids.clear()
        return
    writes: dict[str, int | None] = {}
    for bid in event.bids:
        if (bid.activation, bid.local_task) not in agent.asked_bids:
            continue  # nobody needs it any more
        name = f"{records.BID}/{bid.activation}/{bid.local_task}"
        value, error = bid.performance, bid.error or agent.replica.problem(name, bid.performance)
        if error:
            value = None
            lines = error.strip().splitlines()
            if agent.refusals.count(f"bid for {type_name(bid.local_task)}", lines[-1]):
                agent.log("error", "bid_failed", local_task=bid.local_task, error=error)
        writes[name] = value
    agent.write(sorted(writes.items()), now_us)


def change_capability(agent: Agent, local_task: str, lost: bool, now_us: int) -> str | None:
    """Declare a minor fault or its end; returns what is wrong with it, or None."""
    change = agent.description.lose if lost else agent.description.restore
    problem = change(local_task)
    if problem is not None:
        agent.log("error", "capability_unknown", reason=problem)
        return problem
    agent.log("warning", "capabilities_changed", lost=list(agent.description.lost))
    if agent.joining is None:
        agent.write([(records.MEMBER, agent.description.to_value())], now_us)
    return None


def leave(agent: Agent, now_us: int) -> None:
    """Hand the work over and stop once nothing runs here any more."""
    if agent.leaving:
        return
    agent.description.leaving = True
    agent.log("info", "leaving")
    writes = given_up(agent, agent.work.claim)
    agent.emit(agent.work.drop())
    if agent.joining is None:
        member = (records.MEMBER, agent.description.to_value())
        agent.write([*writes, member, (records.CLAIM, None)], now_us)
    agent.gossip.urge(now_us)
