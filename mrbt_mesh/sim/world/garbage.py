"""Input that no agent may be impressed by: random, truncated, foreign and forged messages."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace

import msgpack

from mrbt_mesh.core.agent.inputs import AnswerReceived, Input, MessageReceived, QueryReceived
from mrbt_mesh.core.membership.wire import Header, MessageKind, encode

PUBLISHED = (MessageKind.HEARTBEAT, MessageKind.FACT)
QUERIES = (MessageKind.PULL, MessageKind.COMMAND)


class Forger:
    """Makes garbage out of one seed; nothing of it is a message that an agent should believe."""

    def __init__(self, seed: int, header: Header) -> None:
        self._random = random.Random(f"{seed}/garbage")
        self._header = header

    def inputs(self, robot: str, robots: Sequence[str], count: int) -> list[Input]:
        """`count` inputs for `robot`, under the names of `robots` and of strangers."""
        return [self._input(robot, robots) for _ in range(count)]

    def _input(self, robot: str, robots: Sequence[str]) -> Input:
        choose = self._random.choice
        source = choose([*(other for other in robots if other != robot), "stranger", "", "../x"])
        make = choose([self._noise, self._truncated, self._foreign, self._wrong_body, self._forged])
        match choose(["publish", "publish", "query", "answer"]):
            case "publish":
                kind = choose(PUBLISHED)
                return MessageReceived(kind, source, make(kind, source, robots))
            case "query":
                kind = choose(QUERIES)
                return QueryReceived(0, kind, make(kind, source, robots))
        if make == self._forged:
            # An answer in due form counts as an answer, whatever entries it lacks or spoils.
            source = "stranger"
        return AnswerReceived(source, make(MessageKind.STATE, source, robots))

    def _noise(self, kind: MessageKind, source: str, robots: Sequence[str]) -> bytes:
        return self._random.randbytes(self._random.randrange(200))

    def _truncated(self, kind: MessageKind, source: str, robots: Sequence[str]) -> bytes:
        whole = encode(replace(self._header, sender=source), kind, self._value(3))
        return whole[: self._random.randrange(len(whole))]

    def _foreign(self, kind: MessageKind, source: str, robots: Sequence[str]) -> bytes:
        """Well-formed, but of another mission, another run, or another version."""
        header = replace(self._header, sender=source)
        match self._random.randrange(3):
            case 0:
                return encode(replace(header, mission="0" * 16, mission_name="other"), kind, [])
            case 1:
                return encode(replace(header, run="another"), kind, [])
        return bytes(msgpack.packb([99, "beat", "", "", "", source, []]))

    def _wrong_body(self, kind: MessageKind, source: str, robots: Sequence[str]) -> bytes:
        # Wrapped, for an empty table would be an answer in due form.
        return encode(replace(self._header, sender=source), kind, ["garbage", self._value(4)])

    def _forged(self, kind: MessageKind, source: str, robots: Sequence[str]) -> bytes:
        """Entries in due form with names and values that mean nothing, or of another author."""
        author = self._random.choice([*robots, "stranger"])
        failure = "latched_failure/a:b:c"
        names = ("claim", "member", "command", "outcome/x/y", failure, "condition/none", "x")
        rows = [[self._random.choice(names), self._value(2) or "?"] for _ in range(3)]
        body = [[author, 1 << 40, "forged", 1, rows, None]]
        return encode(replace(self._header, sender=source), kind, body)

    def _value(self, depth: int) -> object:
        pick = self._random
        match pick.randrange(7 if depth else 5):
            case 0:
                return pick.randrange(-(1 << 40), 1 << 60)
            case 1:
                return pick.randbytes(pick.randrange(20))
            case 2:
                return "x" * pick.randrange(600)
            case 3:
                return pick.choice([True, False, None])
            case 4:
                return pick.random()
            case 5:
                return [self._value(depth - 1) for _ in range(pick.randrange(12))]
        return {f"k{i}": self._value(depth - 1) for i in range(pick.randrange(4))}
