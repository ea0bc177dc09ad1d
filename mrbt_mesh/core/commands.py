"""What an operator may ask of one robot over the network, and the answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.records import OrderKind

if TYPE_CHECKING:
    from mrbt_mesh.core.agent import Agent

FAULT, RESTORE, LEAVE, ORDER = "fault", "restore", "leave", "order"


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
        or not all(isinstance(part, str) and len(part) <= 256 for part in body)
    ):
        return False, "a command is a list of two texts"
    command, argument = body
    match command:
        case "fault" | "restore":
            problem = agent.change_capability(argument, command == FAULT, now_us)
            if problem is not None:
                return False, problem
            lost = ", ".join(agent.description.lost) or "nothing"
            return True, f"{agent.me} has lost {lost}"
        case "leave":
            agent.leave(now_us)
            return True, f"{agent.me} leaves"
        case "order":
            try:
                kind = OrderKind(argument)
            except ValueError:
                return False, f"no order {argument!r}; there is pause, resume, abort"
            agent.order(kind, now_us)
            return True, f"{kind} is the team's order"
    return False, f"no command {command!r}"
