"""An operator's commands over the network: words to this robot, and commands that are facts."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, TypeAlias

from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.agent.job_desk import job_rules
from mrbt_mesh.core.agent.operator_desk import OperatorDesk, team_rules
from mrbt_mesh.core.agent.operator_messages import (
    FAULT,
    LEAVE,
    NOT_READY,
    OPERATE,
    PERFORM,
    REFUSALS,
    RESTORE,
)
from mrbt_mesh.core.agent.parts import Parts
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.facts.description import OPERATOR
from mrbt_mesh.core.mission.mission import micro_performance
from mrbt_mesh.core.mission.names import ALL, type_name

MAX_ARGUMENT = 4_096
MAX_REFUSALS = 100

# Whether a word was obeyed, and a text for people; or the answer to a command that is a fact.
Answer: TypeAlias = tuple[bool, str | dict[str, Any]]


class Commands:
    """Carries out an operator's commands on one robot."""

    def __init__(
        self,
        context: Context,
        reports: Reports,
        health: Health,
        parts: Parts,
    ) -> None:
        self._context = context
        self._reports = reports
        self._health = health
        self._words: dict[str, Callable[[str, int], tuple[bool, str]]] = {
            FAULT: lambda names, now_us: self._change_capability(names, True, now_us),
            RESTORE: lambda names, now_us: self._change_capability(names, False, now_us),
            PERFORM: self._perform,
            LEAVE: self._leave,
            REFUSALS: self._refusals,
            **{word: act for part in parts.all for word, act in part.words().items()},
        }
        # Words of features whose arguments may be longer than others -> how long.
        self._longest = {word: most for part in parts.all for word, most in part.longest().items()}
        rules = dict(team_rules(context))
        if context.facts.jobs is not None:
            rules |= job_rules(context)
        for part in parts.all:
            rules |= part.rules()
        self._desk = OperatorDesk(context, rules)

    def carry_out(self, body: Any, now_us: int) -> Answer | AwaitedAnswer:
        """Carry out a command. Returns (False, why) if it is malformed or unknown.

        An `AwaitedAnswer` is given once the command is on disk.
        """
        if not isinstance(body, list) or len(body) != 2 or not isinstance(body[0], str):
            return False, "a command is a list of a text and its argument"
        command, argument = body
        if command == OPERATE:
            if self._context.is_new:
                text = f"{self._context.me} is still joining the team: ask another robot"
                return True, {"refused": text, "cause": NOT_READY}
            answer = self._desk.take(argument, now_us)
            return answer if isinstance(answer, AwaitedAnswer) else (True, answer)
        most = self._longest.get(command, MAX_ARGUMENT)
        if not isinstance(argument, str) or max(len(command), len(argument)) > most:
            text = "a command is a list of a text and its argument"
            return False, f"{text}, here a text of at most {most} characters"
        carry_out = self._words.get(command)
        return carry_out(argument, now_us) if carry_out else (False, f"no command {command!r}")

    def _change_capability(self, local_task: str, lost: bool, now_us: int) -> tuple[bool, str]:
        change = CapabilityChanged(local_task, lost, OPERATOR, OPERATOR)
        problem = self._health.change_capability(change, now_us)
        if problem is not None:
            return False, problem
        description, me = self._context.description, self._context.me
        names = ", ".join(description.lost) or "nothing"
        kept = [name for name in description.watched if local_task in (ALL, name, type_name(name))]
        if kept and not lost:
            why = f"{kept[0]}: {description.lost[kept[0]]}"
            return False, f"{me} notices the end of this fault itself ({why})"
        return True, f"{me} has lost {names}"

    def _leave(self, _: str, now_us: int) -> tuple[bool, str]:
        self._reports.leave(now_us)
        return True, f"{self._context.me} leaves"

    def _refusals(self, _: str, now_us: int) -> tuple[bool, str]:
        """The most frequent refusals, as JSON: "source: reason" -> how often."""
        counts = sorted(self._context.refused.items(), key=lambda pair: (-pair[1], pair[0]))
        return True, json.dumps(dict(counts[:MAX_REFUSALS]))

    def _perform(self, argument: str, now_us: int) -> tuple[bool, str]:
        """Set a performance. `argument`: a local task and its performance, `replace_hw=0.5`."""
        local_task, _, text = argument.rpartition("=")
        try:
            value = micro_performance(float(text))
        except ValueError:
            return False, f"{argument!r}: LOCAL_TASK=PERFORMANCE expected, e.g. replace_hw=0.5"
        problem = self._health.change_performance(local_task, value, OPERATOR, now_us)
        if problem is not None:
            return False, problem
        me = self._context.me
        return True, f"{me} does {local_task} at {text}" if value else f"{me} has lost {local_task}"
