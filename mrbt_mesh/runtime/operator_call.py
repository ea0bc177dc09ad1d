"""How an operator's client commands a team: it asks all robots at once, until enough have it.

A command is acknowledged once the journals of enough robots hold it; the answer tells the new state
of its subject. A robot that keeps no journal counts if it has the command, unless the command is
about a job. A refused command is not in force.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

import anyio

from mrbt_mesh.core.agent.operator_messages import (
    CONFLICT,
    CONTENDED,
    INVALID,
    NOT_READY,
    OUT_OF_RANGE,
    CommandStep,
    command_version,
)
from mrbt_mesh.core.facts.records import JOB_KINDS
from mrbt_mesh.core.facts.store import Entry, Version
from mrbt_mesh.errors import InputError

# A robot is asked again after this time without an answer; late answers count too.
ANSWER_S = 1.0
CALL_TIMEOUT_S = 10.0
AGAIN_S = 0.1
# How long the remaining robots may answer, where silent ones are named.
REST_S = 0.3
ID_BYTES = 8
# Cause of a refusal: no robot of the team is heard.
NOT_HEARD = "not_heard"


class CommandRefusedError(InputError):
    """A team has refused a command; the message says why, and the state of its subject.

    `cause` is `invalid`, `unknown` (no such subject), `conflict` (the field already has another,
    final value), `ended` (too late), `out_of_range` (a time), `full`, or `not_heard` (no robot is
    heard).
    """

    def __init__(self, text: str, cause: str) -> None:
        super().__init__(text)
        self.cause = cause


@dataclass(frozen=True)
class Acknowledged:
    """A command is in force.

    `state` is the new state of its subject. `robots` are those whose journals hold it, `silent`
    those that have not answered; both are sorted.
    """

    state: dict[str, Any]
    robots: tuple[str, ...]
    silent: tuple[str, ...]

    def text(self, what: str) -> str:
        """Return `what`, followed by the robots that do not have the command yet."""
        return f"{what}; {_not_answered(self.silent)}" if self.silent else what


@dataclass
class OperatorCall:
    """One command to a team.

    `make` returns the command's entry for a version. `ask` returns a robot's answer to a step of
    it, or None; its last argument says whether the robot passes the command on. `robots` returns
    the robots that are heard; `team` are all of the mission. `wanted` is the number of journals
    that must hold it; `needs` are robots that must have it in any case. `is_checked_first`: robots
    may refuse it. `rest_s` is how long it waits for the remaining robots once enough have the
    command.
    """

    make: Callable[[Version], Entry]
    ask: Callable[[str, CommandStep, Entry, bool], Awaitable[dict[str, Any] | None]]
    robots: Callable[[], Collection[str]]
    team: Collection[str]
    wanted: int
    needs: Collection[str] = ()
    is_checked_first: bool = False
    rest_s: float = 0.0
    timeout_s: float = CALL_TIMEOUT_S
    _unkept: set[str] = field(default_factory=set)  # Robots that have a job but no journal for it.
    # Robots that would take the command when asked to check it.
    _answering: set[str] = field(default_factory=set)
    _may_be_written: bool = False
    _id: str = field(default_factory=lambda: secrets.token_hex(ID_BYTES))

    async def carry_out(self, stamp: int) -> Acknowledged:
        """Give the command, starting with this stamp. Raises CommandRefusedError, TimeoutError."""
        entry, keepers = self.make(command_version(stamp, self._id)), dict[str, dict[str, Any]]()
        is_checked = not self.is_checked_first
        with anyio.move_on_after(self.timeout_s):
            while True:
                keepers.clear()
                newest = None if is_checked else await self._check(entry)
                is_checked = is_checked or newest is None
                if newest is None:
                    newest = await self._round(CommandStep.WRITE, entry, keepers)
                if newest is None:
                    return self._acknowledged(keepers)
                entry = self.make(command_version(newest + 1, self._id))
        if self._are_enough(keepers):
            return self._acknowledged(keepers)  # in the very last moment
        raise TimeoutError(self._shortage(keepers))

    def _acknowledged(self, keepers: dict[str, dict[str, Any]]) -> Acknowledged:
        latest = max(keepers.values(), key=_how_new)
        silent = {*self.team, *self.robots()} - keepers.keys()
        return Acknowledged(latest["state"], tuple(sorted(keepers)), tuple(sorted(silent)))

    def _shortage(self, keepers: Collection[str]) -> str:
        """Say which robots have the command, and why each other one does not count."""
        heard = {*self.team, *self.needs, *self.robots()}
        if lacking := sorted({*self.needs} - {*keepers} - self._answering):
            verb = "have" if len(lacking) > 1 else "has"
            written = f"it is in the journals of {_listed(keepers)}"
            text = written if self._may_be_written else "nothing was written"
            return f"{text}: {', '.join(lacking)} {verb} to take it, and {verb} not answered"
        if not self._may_be_written:
            listed = _listed(self._answering)
            text = f"nothing was written: {listed} would take it, and {self.wanted} are needed"
        else:
            text = f"it is in the journals of {_listed(keepers)}, and {self.wanted} were asked for"
            late = self._answering - {*keepers} - self._unkept
            if late:
                names, verb = ", ".join(sorted(late)), "have" if len(late) > 1 else "has"
                text += f"; {names} {verb} not said that it is on disk (is one full?)"
        if self._unkept:
            names, many = ", ".join(sorted(self._unkept)), len(self._unkept) > 1
            text += f"; {names} {'keep' if many else 'keeps'} none, for lack of --run-dir"
        silent = sorted(heard - {*keepers} - self._unkept - self._answering)
        return f"{text}; {_not_answered(silent)}" if silent else text

    def _are_enough(self, robots: Collection[str]) -> bool:
        return len(robots) >= self.wanted and all(robot in robots for robot in self.needs)

    async def _check(self, entry: Entry) -> int | None:
        """Let enough robots check the command, so that nothing is written of a refused one.

        Returns the same as `_round`. If another client gives a command for the same subject at the
        same time, one of them gives up.
        """
        try:
            return await self._round(CommandStep.CHECK, entry, {})
        except CommandRefusedError as refusal:
            await self._give_up(entry)
            if refusal.cause != CONTENDED:
                raise
        await anyio.sleep(AGAIN_S * (1 + secrets.randbelow(10)) / 4)
        return entry.version.incarnation.counter

    async def _give_up(self, entry: Entry) -> None:
        """Release what robots have reserved."""

        async def ask(robot: str) -> None:
            await self.ask(robot, CommandStep.GIVE_UP, entry, False)

        with anyio.move_on_after(AGAIN_S):
            async with anyio.create_task_group() as group:
                for robot in self.robots():
                    group.start_soon(ask, robot)

    async def _round(
        self, step: CommandStep, entry: Entry, takers: dict[str, dict[str, Any]]
    ) -> int | None:
        """Ask all robots until enough have taken the step. Returns None then.

        If another command has been given since, returns the newest known stamp.
        """
        refused: dict[str, CommandRefusedError] = {}
        final = set[str]()  # Those that refuse it for good.
        # Robot -> when to ask it again if it has not taken or refused the step by then.
        ask_at_s: dict[str, float] = {}
        later: list[int] = []
        news = anyio.Event()
        self._may_be_written = self._may_be_written or step is CommandStep.WRITE
        needs_journal = step is CommandStep.WRITE and entry.parts[0] in JOB_KINDS

        async def ask(robot: str) -> None:
            ask_at_s[robot] = anyio.current_time() + ANSWER_S
            answer = _checked(await self.ask(robot, step, entry, self._passes_on(robot, entry)))
            if answer is None or _is_put_off(answer, step):
                ask_at_s[robot] = anyio.current_time() + AGAIN_S
            elif "refused" in answer:
                refused[robot] = CommandRefusedError(answer["refused"], answer["cause"])
                if _is_final(answer, step):
                    final.add(robot)
                ask_at_s[robot] = anyio.current_time() + AGAIN_S
            elif not answer["taken"]:
                later.append(max(answer["stamp"], (answer["newest"] or [0])[0]))
            elif needs_journal and not answer["kept"]:
                self._unkept.add(robot)
            else:
                takers[robot] = answer
                self._answering.add(robot)
                refused.pop(robot, None)
            news.set()

        refusal: CommandRefusedError | None = None
        async with anyio.create_task_group() as group:
            while not later and not self._are_enough(takers) and refusal is None:
                now_s = anyio.current_time()
                for robot in sorted({*self.robots()} - takers.keys() - final - self._unkept):
                    if ask_at_s.get(robot, now_s) <= now_s:
                        group.start_soon(ask, robot)
                with anyio.move_on_after(AGAIN_S):
                    await news.wait()
                news = anyio.Event()
                refusal = self._refusal(step, refused, final, takers, ask_at_s)
            if not later and refusal is None:
                await self._rest(ask_at_s, takers)
            group.cancel_scope.cancel()
        if refusal is not None and not self._are_enough(takers):
            raise refusal
        return max(later) if later else None

    def _passes_on(self, robot: str, entry: Entry) -> bool:
        """Return whether a robot passes the command on.

        Commands about jobs, of which there are many, are passed on by one robot; other commands by
        all.
        """
        robots = sorted(self.robots())
        first = robots[crc32(entry.name.encode()) % len(robots)] if robots else robot
        return entry.parts[0] not in JOB_KINDS or robot == first

    async def _rest(self, asked: Collection[str], takers: Collection[str]) -> None:
        """Give the remaining robots a moment to answer, so that only silent ones are named."""
        with anyio.move_on_after(self.rest_s):
            while any(robot not in takers for robot in asked):
                await anyio.sleep(REST_S / 30)

    def _refusal(
        self,
        step: CommandStep,
        refused: dict[str, CommandRefusedError],
        final: Collection[str],
        takers: Collection[str],
        asked: Collection[str],
    ) -> CommandRefusedError | None:
        """A conflict decides at once; other refusals once too few robots are left to take it.

        What one robot has written is in force once the others hear of it: so it is refused only if
        it has lost for good, or if no robot that was asked may have written it.
        """
        if step is CommandStep.WRITE:
            malformed = INVALID, OUT_OF_RANGE
            is_malformed = any(each.cause in malformed for each in refused.values())
            if final:
                return refused[min(final)]
            if takers or not (is_malformed or refused.keys() >= {*asked}):
                return None
        conflicts = [each for each in refused.values() if each.cause == CONFLICT]
        left = {*self.robots(), *self.needs, *takers} - refused.keys()
        if conflicts or self._are_enough(left):
            return next(iter(conflicts), None)
        return next(iter(refused.values()), None)


def _how_new(answer: dict[str, Any]) -> tuple[bool, Any, int]:
    """Sort key of answers.

    A robot that has a job's change before the job itself knows only its id.
    """
    return len(answer["state"]) > 1, answer["newest"] or [0, ""], answer["stamp"]


def _is_put_off(answer: dict[str, Any], step: CommandStep) -> bool:
    """True if the robot may take the step a moment later."""
    cause = answer.get("cause")
    return cause == NOT_READY or (cause == CONTENDED and step is CommandStep.WRITE)


def _is_final(refusal: dict[str, Any], step: CommandStep) -> bool:
    """True if the robot will never take the step, even if another one has."""
    is_lost = refusal["cause"] == CONFLICT and not refusal.get("may_win")
    return is_lost or step is CommandStep.CHECK


def _not_answered(robots: Sequence[str]) -> str:
    return f"{', '.join(robots)} {'has' if len(robots) == 1 else 'have'} not answered"


def _listed(robots: Collection[str]) -> str:
    """Return `2 robots (A, B)`."""
    count = "1 robot" if len(robots) == 1 else f"{len(robots)} robots"
    return f"{count} ({', '.join(sorted(robots)) or 'nobody'})"


def _checked(answer: dict[str, Any] | None) -> dict[str, Any] | None:
    """Return a complete answer, or None if parts are missing."""
    if answer is None:
        return None
    wanted = {"taken", "kept", "newest", "stamp", "state"}
    wanted = {"refused", "cause"} if "refused" in answer else wanted
    return answer if wanted <= answer.keys() else None
