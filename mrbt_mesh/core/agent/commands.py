"""Commands of an operator to one robot over the network, and the answers."""

from __future__ import annotations

import enum
import json
from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

from mrbt_mesh.core.agent.contact import ContactWatch
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.agent.job_desk import JOB_COMMANDS, JobDesk
from mrbt_mesh.core.agent.jobs_on_disk import AwaitedJob
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.agent.reviser import Reviser
from mrbt_mesh.core.agent.withdrawal import Withdrawal
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.description import OPERATOR
from mrbt_mesh.core.facts.records import LATCH, MAX_MISSION, CoalitionId, CommandKind
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.mission.failure_reasons import one_line
from mrbt_mesh.core.mission.mission import micro_performance

FAULT, RESTORE, LEAVE, TEAM, DECIDE = "fault", "restore", "leave", "team", "decide"
PERFORM = "perform"
BORROW, RETURN = "borrow", "return"
# A sign of life of an operator.
ATTEND = "attend"
# Of BORROW: before or after the task that the robot has.
AT_ONCE, AFTER_TASK = "at_once", "after_task"
REVISE, WITHDRAW, CHECK_REVISION = "revise", "withdraw", "check_revision"
REFUSALS = "refusals"
MAX_ARGUMENT = 4_096
MAX_REFUSALS = 100

# Whether a command was carried out, and a text for people.
Answer: TypeAlias = tuple[bool, str]
# What a robot that is still joining does not do, since what it wrote might lose against its earlier
# life, and what to do instead.
_ONCE_JOINED = dict.fromkeys((BORROW, RETURN), "ask again")
_ONCE_JOINED |= dict.fromkeys((TEAM, DECIDE, REVISE, WITHDRAW, *JOB_COMMANDS), "ask another robot")


class Decision(enum.StrEnum):
    """An operator's decision on an exclusive task in doubt."""

    DONE = "done"
    FAILED = "failed"
    RETRY = "retry"


def command_body(command: str, argument: str = "") -> list[str]:
    """A command as plain data."""
    return [command, argument]


class Commands:
    """Carries out an operator's commands on one robot."""

    def __init__(
        self,
        context: Context,
        planner: Planner,
        reports: Reports,
        health: Health,
        withdrawal: Withdrawal,
        reviser: Reviser,
    ) -> None:
        self._context = context
        self._planner = planner
        self._reports = reports
        self._health = health
        self._withdrawal = withdrawal
        self.contact: ContactWatch | None = None
        self._known: dict[str, Callable[[str, int], Answer | AwaitedJob]] = {
            FAULT: lambda names, now_us: self._change_capability(names, True, now_us),
            RESTORE: lambda names, now_us: self._change_capability(names, False, now_us),
            PERFORM: self._perform,
            LEAVE: self._leave,
            BORROW: self._borrow,
            RETURN: self._return,
            ATTEND: self._attend,
            TEAM: self._team,
            REFUSALS: self._refusals,
            DECIDE: self._decide,
            REVISE: reviser.propose,
            WITHDRAW: reviser.withdraw,
            CHECK_REVISION: reviser.check,
        }
        if context.facts.jobs is not None:
            desk = JobDesk(context, context.facts.jobs)
            self._known |= {name: partial(_of_jobs, desk, name) for name in JOB_COMMANDS}

    def carry_out(self, body: Any, now_us: int) -> Answer | AwaitedJob:
        """Carry out a command; (False, why) for anything malformed or unknown.

        A job that is awaited: the answer comes once it is on disk.
        """
        if (
            not isinstance(body, list)
            or len(body) != 2
            or not all(isinstance(part, str) and len(part) <= 2 * MAX_MISSION for part in body)
        ):
            return False, "a command is a list of two texts"
        command, argument = body
        has_mission = command in (REVISE, CHECK_REVISION)
        if max(len(command), len(argument)) > MAX_ARGUMENT and not has_mission:
            return False, "a command is a list of two texts, and this one is too long"
        if self._context.is_new and command in _ONCE_JOINED:
            me = self._context.me
            return False, f"{me} is still joining the team: {_ONCE_JOINED[command]}"
        carry_out = self._known.get(command)
        return carry_out(argument, now_us) if carry_out else (False, f"no command {command!r}")

    def _change_capability(self, local_task: str, lost: bool, now_us: int) -> Answer:
        change = CapabilityChanged(local_task, lost, OPERATOR, OPERATOR)
        problem = self._health.change_capability(change, now_us)
        if problem is not None:
            return False, problem
        names = ", ".join(self._context.description.lost) or "nothing"
        return True, f"{self._context.me} has lost {names}"

    def _leave(self, _: str, now_us: int) -> Answer:
        self._reports.leave(now_us)
        return True, f"{self._context.me} leaves"

    def _borrow(self, argument: str, now_us: int) -> Answer:
        """`argument`: `at_once anna` or `after_task anna`."""
        when, _, by = argument.partition(" ")
        by = one_line(by)
        if when not in (AT_ONCE, AFTER_TASK) or not by:
            return False, f"{argument!r:.80}: at_once NAME or after_task NAME expected"
        problem = self._withdrawal.borrow(by, when == AFTER_TASK, now_us)
        text = f"{self._context.me} is borrowed by {by}"
        is_after = problem is None and self._withdrawal.waiting
        return problem is None, problem or (f"{text} after its task" if is_after else text)

    def _return(self, _: str, now_us: int) -> Answer:
        problem = self._withdrawal.take_back(now_us)
        return problem is None, problem or f"{self._context.me} works for the team again"

    def _attend(self, _: str, now_us: int) -> Answer:
        if self.contact is not None:
            self.contact.operator_is_here(now_us)
        return True, ""

    def _refusals(self, _: str, now_us: int) -> Answer:
        """The most frequent refusals, as JSON: "source: reason" -> how often."""
        counts = sorted(self._context.refused.items(), key=lambda pair: (-pair[1], pair[0]))
        return True, json.dumps(dict(counts[:MAX_REFUSALS]))

    def _perform(self, argument: str, now_us: int) -> Answer:
        """`argument` is a local task and a performance in units: `replace_hw=0.5`."""
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

    def _team(self, argument: str, now_us: int) -> Answer:
        try:
            kind = CommandKind(argument)
        except ValueError:
            return False, f"no command to the team {argument!r}; there is pause, resume, abort"
        self._reports.command(kind, now_us)
        return True, f"{kind} is the team's command"

    def _in_doubt(self) -> list[tuple[str, list[CoalitionId]]]:
        """Requested exclusive activations that are in doubt, and the coalitions that left them."""
        facts, plan = self._context.facts, self._planner.plan
        requests = plan.evaluation.requests if plan is not None else ()
        doubts = [
            (r.activation, facts.coalitions(r.activation).in_doubt(facts.grantors))
            for r in requests
        ]
        return [(activation, tokens) for activation, tokens in doubts if tokens]

    def _decide(self, argument: str, now_us: int) -> Answer:
        """`argument` is a global task and the operator's decision on it: `dose(2) done`."""
        subject, _, word = argument.rpartition(" ")
        try:
            decision = Decision(word)
        except ValueError:
            return False, f"no decision {word!r}; there is {', '.join(Decision)}"
        doubts = [
            (parse_activation(name).subject, name, tokens) for name, tokens in self._in_doubt()
        ]
        found = [(name, tokens) for task, name, tokens in doubts if task == subject]
        if not found:
            listed = ", ".join(sorted({task for task, _, _ in doubts})) or "none"
            return False, f"{subject!r} is not in doubt (in doubt: {listed})"
        writes: list[Fact] = []
        for activation, tokens in found:
            match decision:
                case Decision.DONE:
                    writes.append((f"{records.DONE}/{activation}", LATCH))
                case Decision.FAILED:
                    writes.append((f"{records.LATCHED_FAILURE}/{activation}", LATCH))
                case Decision.RETRY:
                    writes += [(f"{records.CLEARED}/{activation}/{t}", LATCH) for t in tokens]
        self._context.log("warning", "decision", global_task=subject, decision=word)
        self._context.write(writes, now_us)
        is_retry = decision is Decision.RETRY
        return True, f"{subject} is tried again" if is_retry else f"{subject} counts as {word}"


def _of_jobs(desk: JobDesk, command: str, argument: str, now_us: int) -> Answer | AwaitedJob:
    answer = desk.answer(command, argument, now_us)
    return answer if isinstance(answer, AwaitedJob) else (True, answer)
