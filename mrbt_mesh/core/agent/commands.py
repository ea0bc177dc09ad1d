"""What an operator may ask of one robot over the network, and the answer."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.agent.reports import change_capability, leave
from mrbt_mesh.core.bt.activation import parse_scope
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import OrderKind

if TYPE_CHECKING:
    from mrbt_mesh.core.agent.agent import Agent

FAULT, RESTORE, LEAVE, ORDER, DECIDE = "fault", "restore", "leave", "order", "decide"
MAX_ARGUMENT = 1_024


class Decision(enum.StrEnum):
    """What an operator may say of an exclusive task in doubt."""

    DONE = "done"
    FAILED = "failed"
    RETRY = "retry"


def command_body(command: str, argument: str = "") -> list[str]:
    """A command as plain data."""
    return [command, argument]


def answer_body(good: bool, text: str) -> list[Any]:
    """An answer as plain data: whether it was done, and a text for people."""
    return [good, text]


def carry_out(agent: Agent, body: Any, now_us: int) -> tuple[bool, str]:
    """Do what a command says; (False, why) for anything malformed or unknown."""
    if (
        not isinstance(body, list)
        or len(body) != 2
        or not all(isinstance(part, str) and len(part) <= MAX_ARGUMENT for part in body)
    ):
        return False, "a command is a list of two texts"
    command, argument = body
    match command:
        case "fault" | "restore":
            problem = change_capability(agent, argument, command == FAULT, now_us)
            if problem is not None:
                return False, problem
            lost = ", ".join(agent.description.lost) or "nothing"
            return True, f"{agent.me} has lost {lost}"
        case "leave":
            leave(agent, now_us)
            return True, f"{agent.me} leaves"
        case "order":
            try:
                kind = OrderKind(argument)
            except ValueError:
                return False, f"no order {argument!r}; there is pause, resume, abort"
            if agent.is_new:
                return False, f"{agent.me} is still joining the team: ask again, or another robot"
            agent.order(kind, now_us)
            return True, f"{kind} is the team's order"
        case "decide":
            return _decide(agent, argument, now_us)
    return False, f"no command {command!r}"


def _decide(agent: Agent, argument: str, now_us: int) -> tuple[bool, str]:
    """`argument` is a global task and the operator's word on it: `dose(2) done`."""
    subject, _, word = argument.rpartition(" ")
    try:
        decision = Decision(word)
    except ValueError:
        return False, f"no decision {word!r}; there is {', '.join(Decision)}"
    doubts = agent.in_doubt()
    found = [activation for activation, _ in doubts if parse_scope(activation).subject == subject]
    if not found:
        listed = ", ".join(sorted({parse_scope(name).subject for name, _ in doubts})) or "none"
        return False, f"{subject!r} is not in doubt (in doubt: {listed})"
    writes: list[tuple[str, Any]] = []
    for activation, tokens in doubts:
        if activation not in found:
            continue
        match decision:
            case Decision.DONE:
                writes.append((f"{records.DONE}/{activation}", True))
            case Decision.FAILED:
                writes.append((f"{records.VERDICT}/{activation}", True))
            case Decision.RETRY:
                writes += [(f"{records.CLEARED}/{activation}/{t}", True) for t in tokens]
    agent.log("warning", "decision", global_task=subject, decision=word)
    agent.write(writes, now_us)
    return True, f"{subject} counts as {word}" if word != "retry" else f"{subject} is tried again"
