"""How one robot takes operators' commands: what it refuses, what it writes, what it answers.

An operator's client sends a command to all robots at once. Each robot adds it to its facts and
answers once its journal holds it, with what has become of the field. Commands that robots may
refuse are first checked by a majority, so that nothing of a refused command is written. This check
also reserves a field that is commanded once, so that of two commands with different values at most
one is written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Persist, Publish
from mrbt_mesh.core.agent.operator_messages import (
    CONTENDED,
    INVALID,
    CommandStep,
    command_version,
)
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import OPERATORS, FirstCommand, OperatorCommand
from mrbt_mesh.core.facts.store import Entry, Version, parse_entry
from mrbt_mesh.core.facts.validation import no_place_reason
from mrbt_mesh.core.facts.values import (
    MAX_STAMP,
    read_boolean,
    read_fields,
    read_integer,
    read_text,
)
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.membership.wire import MAX_NONCE, MessageKind

# How far a command's stamp may be ahead of all stamps that this robot has seen.
MAX_AHEAD = 1 << 20
RESERVED_US = 5 * SECOND_US
MAX_RESERVED = 10_000


class RefusalError(ValueError):
    """Why a command is refused, as a text for the operator."""

    def __init__(self, text: str, cause: str = INVALID) -> None:
        super().__init__(text)
        self.cause = cause


@dataclass(frozen=True, slots=True)
class FieldRule:
    """How a robot deals with commands of one field.

    `check` raises RefusalError for a command that cannot be taken now. `known` returns True if the
    field already has this very value for good, and raises RefusalError if it has another one.
    `state`: what has become of the subject.
    """

    state: Callable[[str], dict[str, Any]]
    check: Callable[[Entry, int], None] = lambda *_: None
    known: Callable[[Entry], bool] = lambda _: False


Rules: TypeAlias = Mapping[str, FieldRule]


class OperatorDesk:
    """Takes the commands that operators send to one robot."""

    def __init__(self, context: Context, rules: Rules) -> None:
        self._context = context
        self._rules = rules
        # Entry -> its values, until when they are reserved, and by which version.
        self._reserved: dict[str, tuple[list[Any], int, Version]] = {}

    def take(self, body: Any, now_us: int) -> dict[str, Any] | AwaitedAnswer:
        """Answer a client. A refusal is `{"refused": why, "cause": ..., "may_win": ...}`.
        `may_win`: the command would replace the one that it conflicts with, if another robot has
        already taken it.
        """
        entry = None
        try:
            step, entry, passes_on = self._read(body)
            if step is CommandStep.GIVE_UP:
                self._give_up(entry)
                return {}
            return self._take(step, entry, passes_on, now_us)
        except RefusalError as refusal:
            may_win = entry is not None and self._would_replace(entry)
            return {"refused": str(refusal), "cause": refusal.cause, "may_win": may_win}

    def _would_replace(self, entry: Entry) -> bool:
        """True if the command would be in force here if another robot had taken it."""
        held = self._context.facts.map.get(OPERATORS, entry.name)
        if isinstance(entry.record, FirstCommand):
            return held is not None and entry.version < held.version
        return held is None or entry.version > held.version

    def _read(self, body: Any) -> tuple[CommandStep, Entry, bool]:
        context = self._context
        try:
            step, name, stamp, command_id, value, passes_on = read_fields(body, 6)
            version = command_version(read_integer(stamp), read_text(command_id, MAX_NONCE))
            entry = parse_entry(OPERATORS, read_text(name, records.MAX_NAME), version, value)
            found, is_passed_on = CommandStep(read_text(step)), read_boolean(passes_on)
        except (ValueError, TypeError) as error:
            raise RefusalError(f"malformed command: {error}") from None
        if entry.parts[0] not in self._rules:
            raise RefusalError(f"this mission has no commands of the kind {entry.parts[0]!r}")
        if reason := no_place_reason(entry, context.mission, context.facts.run):
            raise RefusalError(reason)
        if not context.replica.is_authentic(entry):
            raise RefusalError("no operator of this team has signed it")
        if stamp > min(context.facts.max_stamp + MAX_AHEAD, MAX_STAMP):
            raise RefusalError(f"its stamp {stamp} is far ahead of all that {context.me} has seen")
        return found, entry, is_passed_on

    def _take(
        self, step: CommandStep, entry: Entry, passes_on: bool, now_us: int
    ) -> dict[str, Any] | AwaitedAnswer:
        context, name = self._context, entry.name
        rule = self._rules[entry.parts[0]]
        held = context.facts.map.get(OPERATORS, name)
        is_known = held is not None and held.hash == entry.hash
        if is_known or rule.known(entry):
            return self._answer(step, entry, is_taken=True)
        if held is not None and held.version >= entry.version:
            return self._answer(CommandStep.CHECK, entry, is_taken=False)
        rule.check(entry, now_us)
        if isinstance(entry.record, FirstCommand):
            self._reserve(entry, now_us)
        if step is CommandStep.WRITE:
            self._write(entry, passes_on, now_us)
        return self._answer(step, entry, is_taken=True)

    def _answer(
        self, step: CommandStep, entry: Entry, is_taken: bool
    ) -> dict[str, Any] | AwaitedAnswer:
        """Answer a step of a command.

        `taken`: the robot has, or would take, the command; otherwise a newer one was given.
        `newest`: the version of the newest one. `stamp`: the greatest that the robot has seen.
        `kept`: its journal holds the command. `state`: of the subject.
        """

        def make() -> dict[str, Any]:
            found = self._context.facts.map.get(OPERATORS, entry.name)
            newest = list(found.version.incarnation) if found is not None else None
            state = self._rules[entry.parts[0]].state(entry.name.partition("/")[2])
            is_written = is_taken and step is CommandStep.WRITE
            return {
                "taken": is_taken,
                "kept": is_written and self._context.durability.keeps_journal,
                "newest": newest,
                "stamp": self._context.facts.max_stamp,
                "state": state,
            }

        return AwaitedAnswer(entry.name, make) if step is CommandStep.WRITE else make()

    def _reserve(self, entry: Entry, now_us: int) -> None:
        wanted = entry.value[:1]
        values, until_us, _ = self._reserved.get(entry.name, (wanted, 0, entry.version))
        if now_us < until_us and values != wanted:
            raise RefusalError("another client commands this at the same time", CONTENDED)
        self._reserved.pop(entry.name, None)
        self._reserved[entry.name] = wanted, now_us + RESERVED_US, entry.version
        while len(self._reserved) > MAX_RESERVED:
            del self._reserved[next(iter(self._reserved))]

    def _give_up(self, entry: Entry) -> None:
        """Release a reservation, unless a later version holds it: this may arrive late."""
        values, _, version = self._reserved.get(entry.name, (None, 0, entry.version))
        if values == entry.value[:1] and version <= entry.version:
            del self._reserved[entry.name]

    def _write(self, entry: Entry, passes_on: bool, now_us: int) -> None:
        """Add a command to the facts, and pass it on if `passes_on`."""
        context = self._context
        self._reserved.pop(entry.name, None)
        message = context.replica.take_command(entry, now_us)
        number = context.durability.take_number()
        context.commands_on_disk.note(entry.name, number)
        context.emit(Persist((entry,), True, number))
        if passes_on:
            context.emit(Publish(MessageKind.FACT, message))
        assert isinstance(entry.record, OperatorCommand)
        text = records.command_text(entry.parts, entry.record)
        level = "info" if entry.parts[0] in records.JOB_KINDS else "warning"
        context.log(level, "command", command=text, operator=entry.record.operator)


def team_rules(context: Context) -> Rules:
    """The rules of commands to the whole team."""
    order = FieldRule(lambda _: {"order": str(context.facts.order())})
    return {records.PAUSED: order, records.ABORTED: order}
