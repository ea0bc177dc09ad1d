"""Who listens to a team in memory and says again what it has heard, changed."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import msgpack

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.membership.envelope import ForgedError, Guard, parse_envelope
from mrbt_mesh.core.membership.wire import Header, MessageKind, encode
from mrbt_mesh.runtime.member_keys import MemberKeys
from tests.support import build
from tests.support.harness import Team
from tests.support.keys import keys_of

LIFE = 1_000


class Intruders:
    """Strangers without a key, strangers with another team's keys, and members that go too far."""

    def __init__(self, team: Team) -> None:
        self.keys: dict[str, MemberKeys] = {}
        self._team = team
        self._guards: dict[str, Guard] = {}
        self._last_order = b""

    def make_keys(self, robots: Sequence[str]) -> None:
        """The team has keys from now on."""
        self.keys = keys_of(*robots, observer="eye")
        self._others = keys_of(*robots, observer="eye", team="other")
        self._guards = {name: Guard(self.keys[name], build.RUN, LIFE) for name in ("op", "eye")}

    def forge(self, target: str, how: str) -> None:
        """Send again to `target` all that others have published so far, changed in one way:

        again: not at all. bytes: one byte of each message. incarnation: beats of a later life.
        unsigned: without envelopes. other_team: signed with another team's keys. yesterday: signed
        by their senders, in another run. insider: signed by `target`'s first peer, under the names
        of the others.
        """
        heard = [each for each in self._team.heard if each.source != target]
        insider = min(each.source for each in heard)
        for each in heard:
            data = self._forged(each, how, insider)
            if data is not None:
                event = inputs.MessageReceived(each.kind, each.source, data)
                self._team.give(self._team.processes[target], event)

    def _forged(self, heard: inputs.MessageReceived, how: str, insider: str) -> bytes | None:
        envelope = parse_envelope(heard.data)
        inner = envelope.data
        match how:
            case "again":
                return heard.data
            case "bytes":
                at = heard.data.index(inner) + len(inner) // 2
                return heard.data[:at] + bytes([heard.data[at] ^ 1]) + heard.data[at + 1 :]
            case "incarnation":
                if heard.kind is not MessageKind.HEARTBEAT:
                    return None
                message: list[Any] = msgpack.unpackb(inner)
                message[-1][0] += 1
                raised = msgpack.packb(message)
                return heard.data.replace(msgpack.packb(inner), msgpack.packb(raised))
            case "unsigned":
                return inner
            case "other_team":
                return Guard(self._others[heard.source], build.RUN, LIFE).seal(inner)
            case "yesterday":
                return Guard(self.keys[heard.source], "yesterday", LIFE).seal(inner)
            case "insider":
                if heard.source == insider:
                    return None
                return Guard(self.keys[insider], build.RUN, LIFE).seal(inner)
        raise AssertionError(how)

    def ask(self, target: str, who: str) -> None:
        """A member without a process asks for facts."""
        data = encode(self._header(target), MessageKind.PULL, [{}, bytes(8), {}])
        event = inputs.QueryReceived(
            0, MessageKind.PULL, self._guard(target, who).seal(data, (target,))
        )
        self._team.give(self._team.processes[target], event)

    def command(self, target: str, who: str, words: str) -> None:
        """A member gives a command, or the last one comes `again`."""
        if who == "again":
            event = inputs.QueryReceived(0, MessageKind.COMMAND, self._last_order)
            self._team.give(self._team.processes[target], event)
            return
        guard = self._guard(target, who) if who != "stranger" else None
        seal = guard.seal_command if guard is not None else None
        field, value = words.split()
        keys = guard.keys if guard is not None else None
        self._last_order = self._team.operate(target, field, value, seal, keys)

    def _header(self, target: str) -> Header:
        header = self._team.processes[target].agent.view.header
        return Header(header.mission, header.mission_name, header.run, "")

    def _guard(self, target: str, who: str) -> Guard:
        """Seals as `who`, which has heard the target."""
        lives = [parse_envelope(e.data).life for e in self._team.heard if e.source == who]
        life = max(lives, default=LIFE)
        guard = self._guards.setdefault(who, Guard(self.keys[who], build.RUN, life))
        for each in reversed(self._team.heard):
            if each.source == target:
                with contextlib.suppress(ForgedError):  # it has heard this one before
                    guard.open(each.data, each.kind, target)
                break
        return guard
