"""A client of a team that runs: submits jobs, changes them, and waits for their ends.

async with connect("build/run") as team:
    job = await team.submit("deliver", "shelf_2", "dock_1")
    print(await job.done())
"""

from __future__ import annotations

import getpass
import os
import re
import secrets
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import anyio

from mrbt_mesh.core.agent.operator_messages import INVALID, UNKNOWN, command_version
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import (
    ABORTED,
    JOB,
    PAUSED,
)
from mrbt_mesh.core.facts.values import (
    MAX_TEXT,
    printable,
)
from mrbt_mesh.core.membership.timing import SECOND_US, earlier_median
from mrbt_mesh.core.mission.job_arguments import (
    Argument,
    Arguments,
    named_arguments,
)
from mrbt_mesh.core.mission.mission import JobType
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN
from mrbt_mesh.errors import InputError, lone
from mrbt_mesh.features.exclusive.coalitions import coalitions_of, grantors
from mrbt_mesh.features.exclusive.kinds import DECISION, Decision
from mrbt_mesh.observer.job_rows import JobRow, JobRows, why_over
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.job_requests import (
    JobRefusedError,
    arguments_of,
    check_job,
    job_change,
    job_types,
    job_value,
    needs_now,
)
from mrbt_mesh.runtime.known_runs import find_run, is_running
from mrbt_mesh.runtime.operator_call import (
    CALL_TIMEOUT_S,
    NOT_HEARD,
    REST_S,
    Acknowledged,
    CommandRefusedError,
    OperatorCall,
)
from mrbt_mesh.runtime.team_address import TeamAddress, address_of
from mrbt_mesh.runtime.watcher import Watcher, watching

CONNECT_TIMEOUT_S = 10.0
# The numbers of a job's position in the list, and its id.
CURSOR_PATTERN = rf"-?[0-9]{{1,16}}(\.-?[0-9]{{1,16}}){{1,2}}~{ARGUMENT_PATTERN}"
NOBODY_HEARD = "no robot of the team is heard: `mrbt join ROBOT` starts one that has died"
ASK_AGAIN_S = 0.01


@dataclass(frozen=True)
class JobHandle:
    """A submitted job. `state` is open, held, or how it has already ended."""

    id: str
    state: str
    _client: TeamClient

    async def done(self) -> JobRow:
        """Wait until the job has ended, and return its row."""
        return await self._client.wait_for_end(self.id)


class TeamClient:
    """A client of a running team. Use `connect` or `client_of` to make one."""

    def __init__(self, watcher: Watcher) -> None:
        self.watcher = watcher
        self._rows = JobRows()
        self._news = anyio.Event()

    async def follow(self, update: Callable[[], None] = lambda: None) -> None:
        """Keep the known state of the team up to date, and call `update` after changes."""
        heartbeat_s = self.watcher.timing.heartbeat_us / SECOND_US
        while True:
            await self.watcher.wait_for_change(heartbeat_s)
            self.update()
            update()

    def update(self) -> None:
        """Wake those that wait for news; `follow` calls this after each change."""
        self._news.set()
        self._news = anyio.Event()

    @property
    def jobs(self) -> list[JobRow]:
        """All known jobs: open ones in their order, then those that have ended."""
        return self._rows.of(self.watcher.observer)

    def job(self, job_id: str) -> JobRow | None:
        """Return a job, even one that ended long ago; None if no such job is known."""
        row = next((row for row in self.jobs if row.id == job_id), None)
        jobs = self.watcher.observer.facts.jobs
        if row is not None or jobs is None or not jobs.is_archived(job_id):
            return row
        end = jobs.archived_end(job_id)
        what = "only that is" if end is not None else "how is not"
        why = f"it ended long ago, and {what} kept"
        return JobRow(job_id, "", {}, str(end or "ended"), why, 0, (), "")

    def cursor_of(self, row: JobRow) -> str:
        """Return a text for the position of one of the `jobs`, valid for any client of the team."""
        numbers, name = self._rows.place(row.id)
        return f"{'.'.join(map(str, numbers))}~{name}"

    def jobs_after(self, cursor: str) -> list[JobRow]:
        """Return the `jobs` after this cursor. Raises ValueError for an invalid cursor."""
        if re.fullmatch(CURSOR_PATTERN, cursor, re.ASCII) is None:
            raise ValueError("this is not a cursor")
        numbers, _, name = cursor.partition("~")
        after = tuple(map(int, numbers.split("."))), name
        return [row for row in self.jobs if self._rows.place(row.id) > after]

    @property
    def robots(self) -> list[str]:
        """The robots of the team that are alive, sorted."""
        return sorted(self.watcher.observer.membership.members())

    def require_robots(self) -> None:
        """Raise CommandRefusedError unless a robot is heard, for callers that will not wait."""
        if not self.robots:
            raise CommandRefusedError("no robot of the team is heard", NOT_HEARD)

    def arguments_of(self, kind: str, given: Arguments) -> list[str]:
        """Return a job's arguments as texts, in the order of its type's parameters.

        They are given as texts and whole numbers, by position or by the parameters' names. Raises
        JobRefusedError for an unknown type, a wrong number of values, names that do not fit the
        type, and invalid values.
        """
        return arguments_of(self.watcher.observer.mission, kind, given)

    async def submit(
        self,
        kind: str,
        *values: Argument,
        arguments: Arguments | None = None,
        job_id: str = "",
        priority: int | None = None,
        not_before: datetime | timedelta | None = None,
        deadline: datetime | timedelta | None = None,
        safe: int | None = None,
        operator: str = "",
    ) -> JobHandle:
        """Submit a job. Returns once `safe` robots (None: a majority) have it in their journals.

        Its arguments are `values`, in order, or `arguments`: by the parameters' names, or a
        sequence; texts and whole numbers. A submitted job survives the death of all but one of
        these robots, and of the whole team. Submitting the same `job_id` again does nothing. The
        job begins at `not_before` at the earliest and expires at its `deadline` (None: as its type
        says); both are times, or durations from now by the team's clocks. `operator` is who submits
        it; empty means the user who runs this program. Raises JobRefusedError, also if the id
        belongs to another job, and TimeoutError if too few robots answer.
        """
        if values and arguments is not None:
            raise JobRefusedError(
                "give the arguments of a job in order or as `arguments`, not both"
            )
        name = job_id or new_job_id()
        texts = self.arguments_of(kind, values if arguments is None else arguments)
        usual = self.check_job(kind, texts, name, priority, safe)
        until_s = anyio.current_time() + CALL_TIMEOUT_S
        now_us = await self._now_us(until_s) if needs_now(usual, not_before, deadline) else 0
        job = job_value(usual, texts, priority, not_before, deadline, now_us)
        done = await self._command_job(JOB, name, job, operator, safe, until_s=until_s)
        return JobHandle(name, done.state["state"], self)

    def check_job(
        self,
        kind: str,
        arguments: Sequence[str],
        job_id: str,
        priority: int | None,
        safe: int | None,
    ) -> JobType:
        """Return the type of a job. Raises JobRefusedError for what any robot would refuse."""
        mission = self.watcher.observer.mission
        count = len(mission.robots)
        if safe is not None and not 1 <= safe <= count:
            raise JobRefusedError(f"safe {safe}: the mission has {count} robots")
        return check_job(mission, kind, arguments, job_id, priority)

    async def change(
        self, job_id: str, change: str, priority: int | None = None, operator: str = ""
    ) -> dict[str, Any]:
        """Change a job and return its new state, with its arguments as in `JobRow`.

        `change` is `cancel`, `hold`, `hold_now` (which also cancels its running work), `release`,
        or `priority`, with the new `priority`. Returns once a majority has the change in their
        journals. Raises what `submit` raises.
        """
        field, value = job_change(job_id, change, priority)
        return (await self._command_job(field, job_id, value, operator)).state

    async def pause(self, operator: str = "") -> Acknowledged:
        """Stop all work until `resume`.

        Like all commands to the team, returns once a majority has it in their journals. Raises
        CommandRefusedError, and TimeoutError if too few robots answer.
        """
        return await self._command_team(PAUSED, "pause", operator)

    async def resume(self, operator: str = "") -> Acknowledged:
        """Continue the work."""
        return await self._command_team(PAUSED, "resume", operator)

    async def abort(self, operator: str = "") -> Acknowledged:
        """End the mission as failed. This cannot be undone."""
        return await self._command_team(ABORTED, True, operator)

    async def decide(
        self, global_task: str, decision: str, job: str = "", operator: str = ""
    ) -> Acknowledged:
        """Decide that an exclusive task in doubt is `done` or `failed`, or `retry` it.

        `job` names the job of the task; it is required if the task is in doubt in several jobs.
        """
        if decision not in [*Decision]:
            text = f"no decision {decision!r:.80}; there is {', '.join(Decision)}"
            raise CommandRefusedError(text, INVALID)
        names = self._in_doubt()
        found = names.get(global_task, ())
        if not found:
            listed = ", ".join(sorted(names)) or "none"
            text = f"{global_task!r:.80} is not in doubt (in doubt: {listed})"
            raise CommandRefusedError(text, UNKNOWN)
        by_job = sorted({parse_activation(activation).job for activation, _ in found})
        if job not in by_job and (job or len(by_job) > 1):
            listed = ", ".join(each or "none" for each in by_job)
            raise CommandRefusedError(
                f"{global_task} is in doubt in the jobs {listed}: name one", UNKNOWN
            )
        if job:
            found = [each for each in found if parse_activation(each[0]).job == job]
        until_s = anyio.current_time() + CALL_TIMEOUT_S
        for activation, coalition in found:
            done = await self._command(
                f"{DECISION}/{activation}/{coalition}",
                decision,
                operator,
                is_checked=True,
                rest_s=REST_S,
                until_s=until_s,
            )
        return done

    async def propose(
        self, number: int, text: str, is_forced: bool, repeats_exclusive: bool
    ) -> Acknowledged:
        """Propose a compiled mission as the next revision.

        Returns once a majority of the robots that are heard has it.
        """
        from mrbt_mesh.features.revisions.kinds import MISSION

        name, safe = f"{MISSION}/{number}", len(self.robots) // 2 + 1
        return await self._command(
            name, [text, is_forced, repeats_exclusive], "", safe, is_checked=True
        )

    async def withdraw(self, number: int) -> Acknowledged:
        """Withdraw a proposed revision from all robots that are heard."""
        from mrbt_mesh.features.revisions.kinds import MISSION_WITHDRAWN

        return await self._command(
            f"{MISSION_WITHDRAWN}/{number}", True, "", needs=self.robots, is_checked=True
        )

    async def borrow(
        self, robot: str, after_task: bool = False, operator: str = ""
    ) -> Acknowledged:
        """Take a robot out of the team's work until `give_back`, so that the operator can drive it.

        This happens at once, or after its current task if `after_task` is set. Returns once the
        robot itself has it in its journal.
        """
        from mrbt_mesh.features.contact.loans import BORROWED, Loan

        loan = Loan.AFTER_TASK if after_task else Loan.AT_ONCE
        return await self._command_robot(BORROWED, robot, str(loan), operator)

    async def give_back(self, robot: str, operator: str = "") -> Acknowledged:
        """Return a borrowed robot to the team."""
        from mrbt_mesh.features.contact.loans import BORROWED, Loan

        return await self._command_robot(BORROWED, robot, str(Loan.RETURNED), operator)

    async def wait_for_end(self, job_id: str) -> JobRow:
        """Wait until a job has ended, and return its row."""
        while True:
            news = self._news
            facts = self.watcher.observer.facts
            is_over = bool(why_over(self.watcher.observer))
            if facts.jobs is not None and (is_over or facts.jobs.has_ended(job_id)):
                found = self.job(job_id)
                if found is not None:
                    return found
            await news.wait()

    async def _now_us(self, until_s: float) -> int:
        """Return the Unix time by the team's clocks, waiting until `until_s` for a robot to tell
        it.
        """
        with anyio.move_on_after(until_s - anyio.current_time()):
            while True:
                offsets_us = self.watcher.observer.membership.clock_offsets_us()
                if offsets_us:
                    return boottime_us() + earlier_median(offsets_us)
                await anyio.sleep(ASK_AGAIN_S)
        raise TimeoutError(self.watcher.problem or NOBODY_HEARD)

    # -- commanding ---------------------------------------------------------------------------

    def _in_doubt(self) -> dict[str, list[tuple[str, str]]]:
        """Global task -> its requested activations that are in doubt, each with a coalition that
        left it so.
        """
        facts, plan = self.watcher.observer.facts, self.watcher.observer.plan
        found: dict[str, list[tuple[str, str]]] = {}
        for request in plan.evaluation.requests if plan is not None else ():
            for coalition in coalitions_of(facts, request.activation).in_doubt(grantors(facts)):
                subject = parse_activation(request.activation).subject
                found.setdefault(subject, []).append((request.activation, str(coalition)))
        return found

    async def _command_job(
        self,
        field: str,
        job_id: str,
        value: Any,
        operator: str,
        safe: int | None = None,
        until_s: float | None = None,
    ) -> Acknowledged:
        job_types(self.watcher.observer.mission)
        try:
            name = f"{field}/{job_id}"
            done = await self._command(
                name, value, operator, safe, is_checked=True, until_s=until_s
            )
        except CommandRefusedError as refusal:
            raise JobRefusedError(str(refusal), refusal.cause) from None
        except TimeoutError as error:
            fewer = ", or ask for fewer journals (`safe`)" if field == JOB else ""
            raise TimeoutError(f"{job_id}: {error}{fewer}") from None
        # A robot that does not know the job refuses, unless it gets the change first.
        state = done.state
        state.setdefault("state", "open")
        if "arguments" in state:
            types = self.watcher.observer.mission.jobs
            state["arguments"] = named_arguments(types, state["type"], state["arguments"])
        return done

    async def _command_robot(
        self, field: str, robot: str, value: Any, operator: str
    ) -> Acknowledged:
        """Command one robot. Returns once the robot itself has it in its journal."""
        name = f"{field}/{robot}"
        return await self._command(name, value, operator, needs=(robot,), is_checked=True)

    async def _command_team(self, field: str, value: Any, operator: str) -> Acknowledged:
        return await self._command(field, value, operator, rest_s=REST_S)

    async def _command(
        self,
        name: str,
        value: Any,
        operator: str,
        safe: int | None = None,
        *,
        needs: Collection[str] = (),
        is_checked: bool = False,
        rest_s: float = 0.0,
        until_s: float | None = None,
    ) -> Acknowledged:
        """Command a field of a subject.

        `needs` are robots that must have it; by default a majority must. `is_checked`: robots may
        refuse it. `until_s` is the event-loop time at which the command is given up; a request that
        sends several commands shares it among all of them.
        """
        watcher, observer = self.watcher, self.watcher.observer
        who, count = printable(operator or user_name())[:MAX_TEXT], len(observer.mission.robots)
        try:
            watcher.make_command(name, value, who, command_version(0, ""))
        except ValueError as error:
            raise CommandRefusedError(str(error), INVALID) from None
        wanted = (1 if needs else count // 2 + 1) if safe is None else safe
        call = OperatorCall(
            lambda version: watcher.make_command(name, value, who, version),
            watcher.operate,
            lambda: self.robots,
            observer.mission.robots,
            wanted,
            needs,
            is_checked,
            rest_s,
            CALL_TIMEOUT_S if until_s is None else until_s - anyio.current_time(),
        )
        try:
            return await call.carry_out(observer.facts.max_stamp + 1)
        except TimeoutError as error:
            raise TimeoutError(f"{error}: give the same command again") from None


def user_name() -> str:
    """Return the name of the user who runs this program, or the user's number if there is no name,
    as in some containers.
    """
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return f"user {os.getuid()}"


def new_job_id() -> str:
    """Return a unique job id."""
    return f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{secrets.token_hex(4)}"


@asynccontextmanager
async def client_of(address: TeamAddress) -> AsyncIterator[TeamClient]:
    """Connect to the team at an address. Raises TransportError."""
    try:
        async with watching(address) as watcher, anyio.create_task_group() as group:
            await watcher.catch_up(CONNECT_TIMEOUT_S)
            client = TeamClient(watcher)
            group.start_soon(client.follow)
            yield client
            group.cancel_scope.cancel()
    except BaseExceptionGroup as error:
        raise lone(error) from None


@asynccontextmanager
async def connect(run_dir: str | Path | None = None) -> AsyncIterator[TeamClient]:
    """Connect to a team on this machine; None means the only one that runs.

    Raises InputError if there is none, there are several, or it no longer runs, and TransportError.
    """
    found = find_run(Path(run_dir) if run_dir is not None else None)
    if not is_running(found):
        raise InputError(f"the team of {found.path} does not run; `mrbt ls` lists those that do")
    async with client_of(address_of(found)) as client:
        yield client
