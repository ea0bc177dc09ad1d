"""An intruder on the robots' network: a raw Zenoh session, in a process of its own.

    python -m tests.support.raw_intruder '{"how": ["death"], "team": ..., "endpoints": [...], ...}'

It hears all, takes it apart, and says again what it has made of it, with keys of its own making or
stolen ones, until its input ends. Then it prints how many messages it has sent.

`how`: what it does, all of it in turn; a method of `Intruder` each. `rate`: with so many messages
in a second. `activation`, `local_task`: what robots are at work on. `keys`: a folder with the
team's keys; it takes those of `INSIDER` and `OBSERVER`.
"""

from __future__ import annotations

import json
import os
import random
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import zenoh

from benchmarks.flooder import input_ended, open_peer, spoilt
from mrbt_mesh.core.agent.operator_messages import command_body
from mrbt_mesh.core.facts.store import BatchProof, Incarnation, Version, parse_entry
from mrbt_mesh.core.membership.envelope import Envelope, Guard, parse_envelope
from mrbt_mesh.core.membership.keys import Authorship, Keys
from mrbt_mesh.core.membership.wire import (
    MAX_MESSAGE_BYTES,
    SEALED,
    Header,
    MessageKind,
    encode,
    pack_entries,
)
from mrbt_mesh.runtime.key_folder import KeyFolder
from tests.support.keys import keys_of

PAUSE_S, AT_ONCE, LARGE_ONCE_IN = 0.02, 4, 20
INSIDER, OBSERVER = "B1", "screen"
# Places in the body of a heartbeat, see `wire.pack_heartbeat`.
COUNTER, NUMBER, FLAGS, SUSPICIONS, LEASE_REQUEST, GRANTS = 0, 2, 3, 10, 12, 13
LEAVING, DEAD = 2, 3

Said = Iterator[tuple[str, bytes]]


class Intruder:
    """What it has heard, and what it makes of it: (key, message), to be published."""

    def __init__(self, wanted: dict[str, Any]) -> None:
        self._wanted = wanted
        self._prefix = f"mrbt/{wanted['team']}"
        self._dice = random.Random(1)
        self._lock = threading.Lock()
        self._all: list[tuple[str, bytes]] = []
        self._beats: dict[str, tuple[str, Envelope]] = {}
        self._guards: dict[str, Guard] = {}
        self._session = open_peer(wanted["endpoints"])
        kept = zenoh.handlers.Callback(self._hear, indirect=False)
        self._session.declare_subscriber(f"{self._prefix}/**", kept)

    def _hear(self, sample: zenoh.Sample) -> None:
        key, data = str(sample.key_expr), sample.payload.to_bytes()
        if not data:
            return
        envelope = parse_envelope(data)
        with self._lock:
            self._all.append((key, data))
            del self._all[:-2000]
            if "/fact/" not in key:
                self._beats[key] = key, envelope

    def run(self) -> int:
        """Go on until the input ends; how many messages were sent."""
        ended = input_ended()
        sent, begun_s = 0, time.monotonic()
        while not ended.wait(PAUSE_S):
            if not self._beats:
                continue
            for how in self._wanted["how"]:
                for key, data in getattr(self, how)():
                    self._put(key, data)
                    sent += 1
            if self._wanted.get("rate"):
                sent += self._flood(int((time.monotonic() - begun_s) * self._wanted["rate"]) - sent)
        return sent

    def _put(self, key: str, data: bytes) -> None:
        self._session.put(key, data, allowed_destination=zenoh.Locality.REMOTE)

    # -- what it says again, as it was or changed at random -------------------------------------

    def again(self) -> Said:
        """What it has heard, in another order."""
        with self._lock:
            known = list(self._all)
        yield from self._dice.choices(known, k=20)

    def changed(self) -> Said:
        """With some bytes changed."""
        for key, data in self.again():
            yield key, spoilt(data, self._dice)

    def _flood(self, count: int) -> int:
        for key, data in self.again():
            changed = spoilt(data, self._dice)
            for _ in range(count // 20):
                self._put(key, changed)
        return max(0, count // 20) * 20

    # -- heartbeats that it makes anew ----------------------------------------------------------

    def incarnation(self) -> Said:
        """Robots say that they have begun another life."""
        yield from self._new_beats(lambda _, body: body.__setitem__(COUNTER, body[COUNTER] + 1))

    def death(self) -> Said:
        """Robots say that all others are dead, and that they leave. Tokens come and go."""

        def forge(sender: str, body: list[Any]) -> None:
            body[FLAGS] |= LEAVING
            body[SUSPICIONS] = [
                [envelope.sender, *_body(envelope)[:NUMBER], DEAD]
                for _, envelope in self._latest()
                if envelope.sender != sender
            ]

        yield from self._new_beats(forge)
        for _, envelope in self._latest():
            counter, nonce = _body(envelope)[:NUMBER]
            key = f"{self._prefix}/alive/{envelope.sender}/{counter}/{nonce}"
            for name in (key, f"{key}/{self._session.zid()}/direct"):
                self._session.liveliness().declare_token(name).undeclare()
                self._session.delete(name, allowed_destination=zenoh.Locality.REMOTE)

    def grant(self) -> Said:
        """Robots ask for leases, and grant them to one another."""
        activation, coalition = self._wanted["activation"], "A1.1.n.1"

        def forge(_: str, body: list[Any]) -> None:
            body[LEASE_REQUEST] = [activation, coalition]
            body[GRANTS] = [[coalition, robot, 1] for robot in ("A1", "A2", "B1", "B2", "C1", "C2")]

        yield from self._new_beats(forge)

    def _latest(self) -> list[tuple[str, Envelope]]:
        """Some of the heartbeats that were heard last, and their keys."""
        with self._lock:
            beats = list(self._beats.values())
        return self._dice.sample(beats, min(AT_ONCE, len(beats)))

    def _new_beats(self, forge: Any) -> Said:
        for key, envelope in self._latest():
            message = msgpack.unpackb(envelope.data)
            forge(envelope.sender, message[-1])
            message[-1][NUMBER] += 1_000
            yield from self._sealed(key, envelope, msgpack.packb(message))

    def _sealed(self, key: str, heard: Envelope, data: bytes) -> Said:
        """A message with the proof of the one heard, and with a proof by keys of its own making."""
        number = heard.number + 1_000
        parts = [SEALED, heard.run, heard.sender, heard.life, number, heard.to, data, heard.proof]
        yield key, msgpack.packb(parts)
        yield key, Guard(self._made(heard.sender), heard.run, heard.life + 1).seal(data)

    def _made(self, name: str) -> Keys:
        others = ("A1", "A2", "B1", "B2", "C1", "C2")
        return keys_of(*others, operator="operator", observer=OBSERVER, team="intruder")[name]

    # -- facts ----------------------------------------------------------------------------------

    def outcome(self) -> Said:
        """Robots say that they have done what is worked on."""
        name = f"outcome/{self._wanted['activation']}/{self._wanted['local_task']}"
        yield from self._new_facts(name, [True, None])

    def condition(self) -> Said:
        """Robots say that all is well, which would end the mission."""
        yield from self._new_facts("condition/nominal", [True, 1_000, 1_000])

    def _new_facts(self, name: str, value: Any) -> Said:
        for _, heard in self._latest():
            data = self._batch(heard, heard.sender, name, value, self._made(heard.sender))
            yield from self._sealed(f"{self._prefix}/fact/{heard.sender}", heard, data)

    def _batch(self, heard: Envelope, author: str, name: str, value: Any, keys: Keys) -> bytes:
        """A batch of one fact, signed with these keys, in the run and life that were heard."""
        counter, nonce = _body(heard)[:NUMBER]
        proof = BatchProof()
        version = Version(Incarnation(counter, nonce), 1_000)
        entry = parse_entry(author, name, version, value, proof)
        Authorship(keys.was_signed, heard.run).sign(proof, [entry], keys.sign)
        return encode(_header(heard), MessageKind.FACT, pack_entries([entry]))

    # -- with a key of the team -----------------------------------------------------------------

    def insider(self) -> Said:
        """A robot's own key is used to speak as another one, in every place where a name is."""
        for key, heard in self._latest():
            if heard.sender == INSIDER:
                continue
            guard = self._guard_of(INSIDER, heard.run)
            place = f"{self._prefix}/fact"
            fact = self._batch(
                heard, heard.sender, "condition/nominal", [True, 1_000, 1_000], guard.keys
            )
            yield f"{place}/{heard.sender}", guard.seal(fact)
            mine = Header(*msgpack.unpackb(heard.data)[2:5], INSIDER)
            body = msgpack.unpackb(fact)[-1]
            yield f"{place}/{INSIDER}", guard.seal(encode(mine, MessageKind.FACT, body))
            yield f"{key.rpartition('/')[0]}/{INSIDER}", guard.seal(heard.data)
            theirs = heard._replace(number=heard.number + 1_000)
            tags = {name: guard.keys.tag(name, theirs.content) for name in guard.keys.members()}
            yield key, msgpack.packb([SEALED, *theirs[:-1], tags])

    def _guard_of(self, name: str, run: str) -> Guard:
        """Seals with a stolen key."""
        if name not in self._guards:
            keys = KeyFolder(Path(self._wanted["keys"])).keys_of(name)
            self._guards[name] = Guard(keys, run, time.time_ns() // 1_000)
        return self._guards[name]

    def member(self) -> Said:
        """Who holds a robot's key speaks as that robot."""
        for key, heard in self._latest():
            message = msgpack.unpackb(heard.data)
            message[5] = INSIDER
            mine = f"{key.rpartition('/')[0]}/{INSIDER}"
            yield mine, self._guard_of(INSIDER, heard.run).seal(msgpack.packb(message))

    def commands(self) -> Said:
        """Commands without a key, with keys of its own making, and of mere members."""
        for key, heard in self._latest():
            data = encode(_header(heard, ""), MessageKind.COMMAND, command_body("team", "abort"))
            said = [data]
            stolen = [self._guard_of(name, heard.run) for name in (OBSERVER, INSIDER)]
            for guard in (Guard(self._made("operator"), heard.run, heard.life), *stolen):
                said.append(guard.seal_command(data, heard.sender))
                said.append(guard.seal(data, (heard.sender,)))
            for each in said:
                self._session.get(
                    f"{self._prefix}/command/{heard.sender}",
                    zenoh.handlers.Callback(lambda _: None, indirect=False),
                    payload=each,
                )
            yield key, data

    # -- too much -------------------------------------------------------------------------------

    def large(self) -> Said:
        """Messages, questions and names that are larger than any may be."""
        if self._dice.randrange(LARGE_ONCE_IN):
            return  # much of it would be a flood
        for key, heard in self._latest()[:1]:
            data = bytes(MAX_MESSAGE_BYTES + 1)
            yield key, data
            yield f"{self._prefix}/fact/{heard.sender}", data
            yield f"{self._prefix}/fact/{'x' * 100}", b""
            self._session.get(
                f"{self._prefix}/pull/{heard.sender}",
                zenoh.handlers.Callback(lambda _: None, indirect=False),
                payload=data,
            )


def _body(heard: Envelope) -> list[Any]:
    """The body of a heartbeat."""
    body: list[Any] = msgpack.unpackb(heard.data)[-1]
    return body


def _header(heard: Envelope, sender: str | None = None) -> Header:
    """That of the message in an envelope."""
    mission, name, run = msgpack.unpackb(heard.data)[2:5]
    return Header(mission, name, run, heard.sender if sender is None else sender)


if __name__ == "__main__":
    count = Intruder(json.loads(sys.argv[1])).run()
    sys.stdout.write(str(count))
    sys.stdout.flush()
    os._exit(0)
