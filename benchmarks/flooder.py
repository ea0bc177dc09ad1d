"""Floods a team: a raw Zenoh session that says what it hears again, with some bytes changed.

    python -m benchmarks.flooder RATE TEAM ENDPOINT...

It needs no key. Once it floods it says so, and goes on with `RATE` messages a second until its
input ends; then it prints how many it has sent in a second.
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


def tell(line: str) -> None:
    """To whoever has started it."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


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
    enough = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.read()
        enough.set()

    threading.Thread(target=wait_for_end, daemon=True).start()
    sent, begun_s, has_told = 0, time.monotonic(), False
    while not enough.wait(PAUSE_S):
        due = int((time.monotonic() - begun_s) * int(rate)) - sent
        for _ in range(min(due, POOL)):
            key, data = known[sent % POOL]
            session.put(key, data)
            sent += 1
        if not has_told and time.monotonic() > begun_s + WARM_UP_S:
            has_told = True
            tell("flooding")
    tell(str(round(sent / (time.monotonic() - begun_s))))
    os._exit(0)


if __name__ == "__main__":
    main()
