"""An operator's client of the simulated team: it does what those of the runtime do, at once.

Nothing is between it and the robots: the network's faults are for robots alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from typing import Any

from mrbt_mesh.core.agent.inputs import QueryReceived
from mrbt_mesh.core.agent.operator_messages import (
    INVALID,
    NOT_READY,
    OPERATE,
    CommandStep,
    command_body,
    command_version,
    operate_body,
)
from mrbt_mesh.core.facts.records import (
    ABORTED,
    JOB,
    JOB_KINDS,
    PAUSED,
)
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.membership.envelope import Guard
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.membership.wire import MessageKind, decode, encode
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.runtime.job_requests import arguments_of, check_job, job_change, job_value
from mrbt_mesh.runtime.operator_call import AGAIN_S, CALL_TIMEOUT_S, CommandRefusedError
from mrbt_mesh.sim.world import team_commands as commands
from mrbt_mesh.sim.world.clock import MICRO
from mrbt_mesh.sim.world.faults import Fault, Operate, Revise
from mrbt_mesh.sim.world.message_bus import MessageBus
from mrbt_mesh.sim.world.process import SimProcess
from mrbt_mesh.sim.world.robots import Robots
from mrbt_mesh.sim.world.setup import Setup

OPERATOR = "op"
# After so long `mrbt revise` withdraws what is not in force.
IN_FORCE_S = 30.0
# Commands that no robot refuses, and that are in force where they have arrived.
_UNCHECKED = frozenset({PAUSED, ABORTED})


class _NotYetError(Exception):
    """Why a command cannot be given now, though perhaps a moment later."""


@dataclass(slots=True, eq=False)
class _Call:
    """A command under way, when it was given, and what it waits for."""

    given_us: int
    command: commands.TeamCommand
    awaits: str = ""


class Client:
    """Gives commands, and keeps which of them came to nothing."""

    def __init__(self, setup: Setup, bus: MessageBus, robots: Robots, observer: Observer) -> None:
        self._setup = setup
        self._bus = bus
        self._robots = robots
        self._observer = observer
        self._commands = 0
        self._guards: dict[str, Guard] = {}
        self._calls: list[_Call] = []
        self._refusals: list[commands.Refusal] = []
        self._submitted: set[str] = set()

    def refusals(self) -> list[commands.Refusal]:
        """What was refused, or has not been answered, in the order in which it was given."""
        open_calls = [
            commands.Refusal(c.given_us, c.command, f"{c.awaits}, and the run ended")
            for c in self._calls
        ]
        return sorted([*self._refusals, *open_calls], key=lambda refusal: refusal.at_us)

    def jobs_have_ended(self) -> bool:
        """Whether all jobs that it has handed in have ended, and it waits for no answer."""
        jobs = self._observer.facts.jobs
        return not self._calls and jobs is not None and all(map(jobs.has_ended, self._submitted))

    def refuse(self, step: Fault, reason: str) -> None:
        """Note a step of the schedule that comes to nothing now."""
        self._refusals.append(commands.Refusal(self._bus.clock.now_us, step, reason))

    # -- commands to the whole team -----------------------------------------------------------

    def give(self, command: commands.TeamCommand) -> None:
        """Give a command; while robots cannot take it yet, again and again for some seconds."""
        call = _Call(self._bus.clock.now_us, command)
        self._calls.append(call)
        self._try(call)

    def _try(self, call: _Call) -> None:
        try:
            revision = self._carry_out(call.command)
        except _NotYetError as error:
            call.awaits = str(error)
            if not self._again(call, CALL_TIMEOUT_S, AGAIN_S, partial(self._try, call)):
                self._end(call, call.awaits)
        except CommandRefusedError as error:
            self._end(call, str(error))
        else:
            if revision is not None:
                self._await_revision(call, revision)
            else:
                self._end(call)

    def _again(self, call: _Call, limit_s: float, after_s: float, step: Callable[[], None]) -> bool:
        """Take a step later, unless the call has taken too long; whether it has not."""
        now_us = self._bus.clock.now_us
        is_in_time = now_us - call.given_us < round(limit_s * MICRO)
        if is_in_time:
            self._bus.clock.at(now_us + round(after_s * MICRO), step)
        return is_in_time

    def _end(self, call: _Call, refusal: str = "") -> None:
        self._calls.remove(call)
        if refusal:
            self._refusals.append(commands.Refusal(call.given_us, call.command, refusal))

    def _carry_out(self, command: commands.TeamCommand) -> Mission | None:
        """Give it now; the revision that it proposes."""
        if not isinstance(command, commands.Propose):
            needs = command.robot if isinstance(command, commands.OfRobot) else ""
            self._command(*self._content(command), needs)
            return None
        # Loaded here, as other features are: teams without them need nothing of it.
        from mrbt_mesh.features.revisions.commands import next_revision, proposal

        revision = next_revision(self._observer.facts, command.mission)
        if isinstance(revision, str):
            raise CommandRefusedError(revision, INVALID)
        self._command(*proposal(revision, command))
        return revision

    def _content(self, command: commands.TeamCommand) -> tuple[str, str, Any]:
        """The field, its subject and the value of a command; raises CommandRefusedError for what
        cannot be, by the mission that the client knows.
        """
        match command:
            case commands.Submit():
                return JOB, command.id, self._job(command)
            case commands.OfRobot(robot):
                field, value = command.content()
                return field, robot, value
            case commands.PauseTeam():
                return PAUSED, "", "pause"
            case commands.ResumeTeam():
                return PAUSED, "", "resume"
            case commands.AbortMission():
                return ABORTED, "", True
        job, change, priority = _change_of_job(command)
        field, value = job_change(job, change, priority)
        return field, job, value

    def _job(self, job: commands.Submit) -> list[Any]:
        mission = self._observer.mission
        arguments = arguments_of(mission, job.type, job.arguments)
        kind = check_job(mission, job.type, arguments, job.id, job.priority)
        times = [
            None if seconds is None else timedelta(seconds=seconds)
            for seconds in (job.not_before_s, job.deadline_s)
        ]
        now_us = self._setup.launch_unix_us + self._bus.clock.now_us
        return job_value(kind, arguments, job.priority, times[0], times[1], now_us)

    def _command(self, field: str, subject: str, value: Any, needs: str = "") -> None:
        """Command all robots that are heard and live, after one has checked it. `needs`: a robot
        of the mission that has to answer.
        """
        heard = self._observer.membership.members()
        robots = [each for each in self._robots.living() if each.robot in heard]
        names = [each.robot for each in robots]
        if not robots:
            raise _NotYetError("no robot of the team is heard")
        if needs in self._observer.mission.robots and needs not in names:
            raise _NotYetError(f"{needs} does not answer")
        entry = self._entry(robots[0], f"{field}/{subject}" if subject else field, value, OPERATOR)
        if field not in _UNCHECKED:
            self._check(robots[0], entry)
        # As many journals are to hold a job.
        wanted = len(self._observer.mission.robots) // 2 + 1
        if field in JOB_KINDS and len(names) < wanted:
            self._ask(robots[0], entry, OPERATOR, CommandStep.GIVE_UP)
            text = f"{', '.join(names)} would take it, and {wanted} robots are needed"
            raise _NotYetError(f"nothing was written: {text}")
        self._write(names, entry, OPERATOR)
        if field == JOB:
            self._submitted.add(subject)

    def _check(self, process: SimProcess, entry: Entry) -> None:
        """Raise CommandRefusedError if this robot refuses it."""
        answers: list[bytes] = []
        self._ask(process, entry, OPERATOR, CommandStep.CHECK, self._bus.await_answer(answers))
        if not answers:
            raise _NotYetError(f"{process.robot} does not answer")
        data, guard = answers[0], self._guards.get(OPERATOR)
        if guard is not None:
            _, data = guard.open(data, MessageKind.ANSWER, process.robot)
        _, (is_obeyed, answer) = decode(data, self._setup.header, MessageKind.ANSWER)
        if not is_obeyed:
            raise CommandRefusedError(str(answer), "")
        if answer.get("cause") == NOT_READY:
            raise _NotYetError(answer["refused"])
        if "refused" in answer:
            raise CommandRefusedError(answer["refused"], answer["cause"])

    def _await_revision(self, call: _Call, revision: Mission) -> None:
        """Look now and again whether the revision is in force or void."""
        from mrbt_mesh.features.revisions import commands as revisions

        facts = self._observer.facts
        if revisions.is_in_force(facts, revision):
            self._end(call)
        elif reason := revisions.void_reason(facts, revision):
            self._end(call, reason)
        else:
            alive = self._observer.membership.members()
            awaited = ", ".join(revisions.awaited(facts, revision, alive))
            call.awaits = f"waited for {awaited or 'a majority of the robots'}"
            step = partial(self._await_revision, call, revision)
            if not self._again(call, IN_FORCE_S, self._setup.timing.heartbeat_us / MICRO, step):
                self._end(call, f"not in force after {IN_FORCE_S:g} s, {call.awaits}")
                self._withdraw(revisions.withdrawal(revision))

    def _withdraw(self, name: str) -> None:
        names = [each.robot for each in self._robots.living()]
        for first in self._robots.living()[:1]:
            entry = self._entry(first, name, True, OPERATOR)
            self._write(names, entry, OPERATOR)

    # -- steps of chaos: a client that knows what one robot knows ------------------------------

    def revise(self, process: SimProcess, fault: Revise) -> None:
        """As `mrbt revise` does it, by what the asked robot knows."""
        if process.agent is None:
            return
        from mrbt_mesh.features.revisions.commands import proposal, revision_of

        found = revision_of(process.agent.view.facts, fault)
        field, number, value = proposal(found, fault)
        self.operate(process, Operate(fault.robot, f"{field}/{number}", value))

    def operate(self, process: SimProcess, fault: Operate) -> None:
        """As a client does it that has the facts of the robot."""
        if process.agent is not None:
            entry = self._entry(process, fault.name, fault.value, fault.operator)
            self._write((fault.robot, *fault.also), entry, fault.operator)

    # -- what goes to robots -----------------------------------------------------------------

    def _entry(self, process: SimProcess, name: str, value: Any, operator: str) -> Entry:
        """A command that is newer than all that this robot has seen."""
        assert process.agent is not None
        self._commands += 1
        version = command_version(process.agent.view.facts.max_stamp + 1, str(self._commands))
        keys = self._setup.agents.keys.get(operator)
        return make_command(name, value, operator, version, self._setup.header.run, keys)

    def _write(self, robots: Iterable[str], entry: Entry, operator: str) -> None:
        """The first of these robots passes it on to others, too."""
        passes_on = True
        for robot in robots:
            process = self._robots.processes.get(robot)
            if process is not None and not process.is_over:
                self._ask(process, entry, operator, CommandStep.WRITE, passes_on=passes_on)
            passes_on = False

    def _ask(
        self,
        process: SimProcess,
        entry: Entry,
        operator: str,
        step: CommandStep,
        query: int = 0,
        *,
        passes_on: bool = False,
    ) -> None:
        header, keys = self._setup.header, self._setup.agents.keys.get(operator)
        body = command_body(OPERATE, operate_body(step, entry, passes_on))
        data = encode(header, MessageKind.COMMAND, body)
        if keys is not None:
            guard = self._guards.setdefault(operator, Guard(keys, header.run, life=1))
            data = guard.seal_command(data, process.robot, self._robots.lives[process.robot])
        process.deliver(QueryReceived(query, MessageKind.COMMAND, data))


def _change_of_job(command: commands.TeamCommand) -> tuple[str, str, int | None]:
    """The job, the change, and the new priority if it is that."""
    match command:
        case commands.CancelJob(job):
            return job, "cancel", None
        case commands.HoldJob(job, now):
            return job, "hold_now" if now else "hold", None
        case commands.ReleaseJob(job):
            return job, "release", None
        case commands.SetPriority(job, priority):
            return job, "priority", priority
    raise TypeError(f"unknown command {command!r}")
