"""A client of a team that runs: submits jobs, changes them, and waits for their ends.

async with connect("build/run") as team:
    job = await team.submit("deliver", "shelf_2", "dock_1")
    print(await job.done())
"""

from __future__ import annotations

import contextlib
import getpass
import json
import os
import secrets
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from zlib import crc32

import anyio

from mrbt_mesh.core.agent.job_desk import CHANGE_JOB, INVALID, KEPT_JOB, NOT_READY, SUBMIT
from mrbt_mesh.core.agent.wall_clock import earlier_median
from mrbt_mesh.core.facts.records import JOB
from mrbt_mesh.core.facts.values import MAX_TEXT
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import JobType
from mrbt_mesh.core.observer.job_rows import JobRow, JobRows
from mrbt_mesh.errors import InputError, lone, nearest
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.known_runs import find_run, is_running
from mrbt_mesh.runtime.team import address_of
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import Watcher, watching

CONNECT_TIMEOUT_S = 10.0
# A robot that does not answer for so long is left out, and another one is asked.
ANSWER_S = 1.0
SUBMIT_TIMEOUT_S = KEEP_TIMEOUT_S = 10.0
NOBODY_HEARD = "no robot of the team is heard: `mrbt join ROBOT` starts one that has died"
ASK_AGAIN_S, KEPT_AGAIN_S = 0.01, 0.1


class JobRefusedError(InputError):
    """A team has refused a job, or a change of one; the text says why.

    `cause`: `invalid`, `unknown` (no job has this id), `conflict` (another job has it), or `full`.
    """

    def __init__(self, text: str, cause: str = INVALID) -> None:
        super().__init__(text)
        self.cause = cause


@dataclass(frozen=True)
class JobHandle:
    """A job that was submitted. `state`: open, held, or how it has ended already."""

    id: str
    state: str
    _client: TeamClient

    async def done(self) -> JobRow:
        """Wait until it has ended; how it has."""
        return await self._client.wait_for_end(self.id)


class TeamClient:
    """Use `connect` or `client_of` to make one."""

    def __init__(self, watcher: Watcher) -> None:
        self.watcher = watcher
        self._rows = JobRows()
        self._news = anyio.Event()

    async def follow(self, update: Callable[[], None] = lambda: None) -> None:
        """Keep what is known of the team up to date, and call `update` after changes."""
        heartbeat_s = self.watcher.timing.heartbeat_us / SECOND_US
        while True:
            await self.watcher.wait_for_change(heartbeat_s)
            self.update()
            update()

    def update(self) -> None:
        """Look again at what the watcher knows, after a change; `follow` calls this."""
        self._news.set()
        self._news = anyio.Event()

    @property
    def jobs(self) -> list[JobRow]:
        """All jobs that are known: open ones in their order, then those that have ended."""
        observer = self.watcher.observer
        return self._rows.update(observer.facts, observer.plan, observer.membership.members())

    @property
    def robots(self) -> list[str]:
        """The robots of the team that are alive, sorted."""
        return sorted(self.watcher.observer.membership.members())

    def arguments_of(self, kind: str, values: Mapping[str, Any]) -> list[str]:
        """The arguments of a job in order, of texts and whole numbers by the parameters' names.

        Raises JobRefusedError for names that do not fit the type, and for other values.
        """
        types = self.watcher.observer.mission.jobs
        if kind not in types:
            raise JobRefusedError(f"no job type {kind!r:.80}" + nearest(kind, types))
        names = [each.name for each in types[kind].parameters]
        if sorted(values) != sorted(names):
            given = ", ".join(sorted(values)) or "none"
            wanted = ", ".join(names) or "none"
            raise JobRefusedError(f"{kind} takes the arguments {wanted}; given: {given:.200}")
        for name in names:
            if isinstance(values[name], bool) or not isinstance(values[name], str | int):
                raise JobRefusedError(f"{name} is a text or a whole number")
        return [str(values[name]) for name in names]

    async def submit(
        self,
        kind: str,
        *arguments: str,
        job_id: str = "",
        priority: int | None = None,
        not_before: datetime | timedelta | None = None,
        deadline: datetime | timedelta | None = None,
        safe: int | None = None,
        operator: str = "",
    ) -> JobHandle:
        """Hand in a job; returns once `safe` robots (None: a majority) have it in their journals.

        Then it survives the death of all but one of them, and of the team. To submit the same
        `job_id` again does nothing. It begins at `not_before` at the earliest, and expires at its
        `deadline` (None: as its type says): times, or how long from now by the team's clocks.
        `operator`: who submits it; empty: the user who runs this program. Raises JobRefusedError,
        TimeoutError if too few robots answer.
        """
        count = len(self.watcher.observer.mission.robots)
        if safe is not None and not 1 <= safe <= count:
            raise JobRefusedError(f"safe {safe}: the mission has {count} robots")
        name = job_id or _new_id()
        usual = self.watcher.observer.mission.jobs.get(kind) or JobType(kind)
        not_before_us = 0 if not_before is None else await self._unix_us(not_before)
        if deadline is None and usual.deadline_us is not None:
            now_us = await self._unix_us(timedelta())
            deadline_us = max(now_us, not_before_us) + usual.deadline_us
        else:
            deadline_us = 0 if deadline is None else await self._unix_us(deadline)
        given: dict[str, Any] = {
            "type": kind,
            "arguments": list(arguments),
            "priority": usual.priority if priority is None else priority,
            "not_before_us": not_before_us,
            "deadline_us": deadline_us,
            "operator": (operator or user_name())[:MAX_TEXT],
        }
        proof = self.watcher.signed(f"{JOB}/{name}", [*given.values()])
        answer = await self._ask_any(SUBMIT, {"id": name, **given, **proof})
        await self._await_kept(name, answer["stamp"], safe)
        return JobHandle(name, answer["state"], self)

    async def change(self, job_id: str, change: str, priority: int | None = None) -> dict[str, Any]:
        """`cancel`, `hold`, `release`, or give another `priority`; the state of the job then.

        Returns once a majority has it in their journals. Raises as `submit`.
        """
        given: dict[str, Any] = {"id": job_id, "change": change}
        if priority is not None:
            given["priority"] = priority
        state = await self._ask_any(CHANGE_JOB, given)
        await self._await_kept(job_id, state["stamp"], None)
        return state

    async def wait_for_end(self, job_id: str) -> JobRow:
        """Wait until a job has ended; how it has."""
        while True:
            news = self._news
            facts = self.watcher.observer.facts
            if facts.jobs is not None and facts.jobs.has_ended(job_id):
                return next(row for row in self.jobs if row.id == job_id)
            await news.wait()

    async def _unix_us(self, when: datetime | timedelta) -> int:
        """A time, or how long from now, as a Unix time in microseconds."""
        if isinstance(when, datetime):
            return round(when.timestamp() * SECOND_US)
        with anyio.move_on_after(SUBMIT_TIMEOUT_S):
            while True:
                offsets_us = self.watcher.observer.membership.clock_offsets_us()
                if offsets_us:
                    now_us = boottime_us() + earlier_median(offsets_us)
                    return now_us + when // timedelta(microseconds=1)
                await anyio.sleep(ASK_AGAIN_S)
        raise TimeoutError(NOBODY_HEARD)

    # -- asking robots ------------------------------------------------------------------------

    async def _ask_any(self, command: str, given: dict[str, Any]) -> dict[str, Any]:
        """The first answer of any robot; one that does not answer, or still joins, is left out.

        The job's id decides which robot is asked first: so all share the work, and one robot sees
        first if two clients use the same id.
        """
        mission = self.watcher.observer.mission
        if not mission.jobs:
            raise JobRefusedError(
                f"mission {mission.name} has no types of jobs (jobs: in its file)"
            )
        problem = NOBODY_HEARD
        with anyio.move_on_after(SUBMIT_TIMEOUT_S):
            while True:
                robots = self.robots
                first = crc32(given["id"].encode()) % max(1, len(robots))
                for robot in (*robots[first:], *robots[:first]):
                    answer, problem = await self._ask(robot, command, given)
                    if answer is not None and answer.get("cause") == NOT_READY:
                        problem = answer["refused"]
                    elif answer is not None and "refused" in answer:
                        raise JobRefusedError(answer["refused"], answer["cause"])
                    elif answer is not None:
                        return answer
                await anyio.sleep(ASK_AGAIN_S)
        raise TimeoutError(problem)

    async def _await_kept(self, name: str, stamp: int, safe: int | None) -> None:
        """Wait until enough robots have what was written of a job up to `stamp` in their journals.

        Each robot is asked once, and answers when it has; one that does not answer is asked again.
        """
        count = len(self.watcher.observer.mission.robots)
        wanted = count // 2 + 1 if safe is None else safe
        keepers: set[str] = set()
        asked: set[str] = set()
        are_enough = anyio.Event()

        async def ask(robot: str) -> None:
            answer, _ = await self._ask(robot, KEPT_JOB, {"id": name, "stamp": stamp})
            if answer is None or answer.get("kept") is not True:
                asked.discard(robot)
                return
            keepers.add(robot)
            if len(keepers) >= wanted:
                are_enough.set()

        with anyio.move_on_after(KEEP_TIMEOUT_S):
            async with anyio.create_task_group() as group:
                while not are_enough.is_set():
                    for robot in self.robots:
                        if robot not in asked:
                            asked.add(robot)
                            group.start_soon(ask, robot)
                    with anyio.move_on_after(KEPT_AGAIN_S):
                        await are_enough.wait()
                group.cancel_scope.cancel()
            return
        listed = ", ".join(sorted(keepers)) or "nobody"
        raise TimeoutError(
            f"{name} is in the journals of {len(keepers)} robots ({listed}), and {wanted} "
            "were asked for: submit it again under this id, or ask for fewer"
        )

    async def _ask(
        self, robot: str, command: str, given: dict[str, Any]
    ) -> tuple[dict[str, Any] | None, str]:
        """The robot's answer, or None and why there is none."""
        with anyio.move_on_after(ANSWER_S):
            good, text = await self.watcher.command(robot, command, json.dumps(given))
            if not good:
                return None, text
            with contextlib.suppress(ValueError, RecursionError):
                if isinstance(answer := json.loads(text), dict):
                    return answer, ""
            return None, f"{robot} answered something strange: {text!r:.80}"
        return None, f"{robot} does not answer"


def user_name() -> str:
    """Who runs this program: its user's name, or number if it has none, as in some containers."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return f"user {os.getuid()}"


def _new_id() -> str:
    return f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{secrets.token_hex(4)}"


@asynccontextmanager
async def client_of(address: TeamAddress) -> AsyncIterator[TeamClient]:
    """A client of the team at an address. Raises TransportError."""
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
    """A client of a team of this machine; None: the only one that runs.

    Raises InputError if there is none or several, or it does not run any more, TransportError.
    """
    found = find_run(Path(run_dir) if run_dir is not None else None)
    if not is_running(found):
        raise InputError(f"the team of {found.path} does not run; `mrbt ls` lists those that do")
    async with client_of(address_of(found)) as client:
        yield client
