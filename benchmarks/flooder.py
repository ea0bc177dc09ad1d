"""Floods a team: a raw Zenoh session that repeats what it hears, with some bytes changed.

    python -m benchmarks.flooder RATE TEAM ENDPOINT...

It needs no key. It prints a line when the flood has begun, and goes on with `RATE` messages a
second until its input ends; then it prints how many it has sent in a second.
"""

from __future__ import annotations

import json
import os
import random
import sys
import threading
import time

import zenoh

POOL, PAUSE_S, WARM_UP_S = 2_000, 0.001, 1.0


def spoilt(data: bytes, dice: random.Random) -> bytes:
    """With one to four bytes changed."""
    found = bytearray(data)
    for _ in range(dice.randint(1, 4)):
        found[dice.randrange(len(data))] ^= dice.randint(1, 255)
    return bytes(found)


def open_peer(endpoints: list[str]) -> zenoh.Session:
    """A session of a peer that dials these."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", json.dumps(endpoints))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    return zenoh.open(config)


def report(line: str) -> None:
    """Print a line for the program that has started this one."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def input_ended() -> threading.Event:
    """Set once this process' input has ended."""
    ended = threading.Event()

    def wait() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    return ended


def main() -> None:
    """Flood until the input ends."""
    rate, team, *endpoints = sys.argv[1:]
    session = open_peer(endpoints)
    heard: list[tuple[str, bytes]] = []

    def hear(sample: zenoh.Sample) -> None:
        if len(heard) < POOL:
            heard.append((str(sample.key_expr), sample.payload.to_bytes()))

    callback = zenoh.handlers.Callback(hear, indirect=False)
    subscriber = session.declare_subscriber(
        f"mrbt/{team}/**", callback, allowed_origin=zenoh.Locality.REMOTE
    )
    while len(heard) < 30:
        time.sleep(PAUSE_S)
    subscriber.undeclare()
    dice = random.Random(1)
    known = [(key, spoilt(data, dice)) for key, data in dice.choices(heard, k=POOL)]
    sent, begun_s, has_begun, ended = 0, time.monotonic(), False, input_ended()
    while not ended.wait(PAUSE_S):
        due = int((time.monotonic() - begun_s) * int(rate)) - sent
        for _ in range(min(due, POOL)):
            session.put(*known[sent % POOL])
            sent += 1
        if not has_begun and time.monotonic() > begun_s + WARM_UP_S:
            has_begun = True
            report("flooding")
    report(str(round(sent / (time.monotonic() - begun_s))))
    os._exit(0)


if __name__ == "__main__":
    main()
