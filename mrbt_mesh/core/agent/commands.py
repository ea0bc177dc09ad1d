"""What an operator may ask of one robot over the network, and the answer."""

from __future__ import annotations

import enum
import json
from typing import Any

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.description import OPERATOR
from mrbt_mesh.core.facts.records import LATCH, CoalitionId, OrderKind
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.mission.mission import micro_performance

FAULT, RESTORE, LEAVE, ORDER, DECIDE = "fault", "restore", "leave", "order", "decide"
PERFORM = "perform"
REFUSALS = "refusals"
MAX_ARGUMENT = 1_024
MAX_REFUSALS = 100


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


class Commands:
    """Carries out what an operator asks of one robot."""

    def __init__(
        self, context: Context, planner: Planner, reports: Reports, health: Health
    ) -> None:
        self._context = context
        self._planner = planner
        self._reports = reports
        self._health = health

    def carry_out(self, body: Any, now_us: int) -> tuple[bool, str]:
        """Do what a command says; (False, why) for anything malformed or unknown."""
        if (
            not isinstance(body, list)
            or len(body) != 2
            or not all(isinstance(part, str) and len(part) <= MAX_ARGUMENT for part in body)
        ):
            return False, "a command is a list of two texts"
        command, argument = body
        me = self._context.me
        match command:
            case "fault" | "restore":
                change = CapabilityChanged(argument, command == FAULT, OPERATOR, OPERATOR)
                problem = self._health.change_capability(change, now_us)
                if problem is not None:
                    return False, problem
                names = ", ".join(self._context.description.lost) or "nothing"
                return True, f"{me} has lost {names}"
            case "perform":
                return self._perform(argument, now_us)
            case "leave":
                self._reports.leave(now_us)
                return True, f"{me} leaves"
            case "order":
                return self._order(argument, now_us)
            case "refusals":
                return True, self._refusals()
            case "decide":
                return self._decide(argument, now_us)
        return False, f"no command {command!r}"

    def _refusals(self) -> str:
        """What was refused most, as JSON: "source: reason" -> how often."""
        counts = sorted(self._context.refused.items(), key=lambda pair: (-pair[1], pair[0]))
        return json.dumps(dict(counts[:MAX_REFUSALS]))

    def _perform(self, argument: str, now_us: int) -> tuple[bool, str]:
        """`argument` is a local task and a performance in units: `replace_hw=0.5`."""
        local_task, _, text = argument.rpartition("=")
        try:
            value = micro_performance(float(text))
        except ValueError:
            return False, f"{argument!r}: LOCAL_TASK=PERFORMANCE expected, e.g. replace_hw=0.5"
        problem = self._health.change_performance(local_task, value, OPERATOR, now_us)
        if problem is not None:
            return False, problem
        me, lost = self._context.me, not value
        return True, f"{me} has lost {local_task}" if lost else f"{me} does {local_task} at {text}"

    def _order(self, argument: str, now_us: int) -> tuple[bool, str]:
        me = self._context.me
        try:
            kind = OrderKind(argument)
        except ValueError:
            return False, f"no order {argument!r}; there is pause, resume, abort"
        if self._context.is_new:
            return False, f"{me} is still joining the team: ask again, or another robot"
        self._reports.order(kind, now_us)
        return True, f"{kind} is the team's order"

    def _in_doubt(self) -> list[tuple[str, list[CoalitionId]]]:
        """Requested exclusive activations that are in doubt, and the coalitions that left them."""
        facts, plan = self._context.facts, self._planner.plan
        requests = plan.evaluation.requests if plan is not None else ()
        doubts = [
            (r.activation, facts.coalitions(r.activation).in_doubt(facts.grantors))
            for r in requests
        ]
        return [(activation, tokens) for activation, tokens in doubts if tokens]

    def _decide(self, argument: str, now_us: int) -> tuple[bool, str]:
        """`argument` is a global task and the operator's word on it: `dose(2) done`."""
        subject, _, word = argument.rpartition(" ")
        try:
            decision = Decision(word)
        except ValueError:
            return False, f"no decision {word!r}; there is {', '.join(Decision)}"
        doubts = self._in_doubt()
        found = [name for name, _ in doubts if parse_activation(name).subject == subject]
        if not found:
            listed = (
                ", ".join(sorted({parse_activation(name).subject for name, _ in doubts})) or "none"
            )
            return False, f"{subject!r} is not in doubt (in doubt: {listed})"
        writes: list[Fact] = []
        for activation, tokens in doubts:
            if activation not in found:
                continue
            match decision:
                case Decision.DONE:
                    writes.append((f"{records.DONE}/{activation}", LATCH))
                case Decision.FAILED:
                    writes.append((f"{records.VERDICT}/{activation}", LATCH))
                case Decision.RETRY:
                    writes += [(f"{records.CLEARED}/{activation}/{t}", LATCH) for t in tokens]
        self._context.log("warning", "decision", global_task=subject, decision=word)
        self._context.write(writes, now_us)
        return (
            True,
            f"{subject} counts as {word}" if word != "retry" else f"{subject} is tried again",
        )
