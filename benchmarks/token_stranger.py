"""A stranger on a team's network who shows liveliness tokens in its robots' names and drops them.

    python -m benchmarks.token_stranger COUNT NAMES TEAM ENDPOINT...

It needs no key: a raw Zenoh session that lists the tokens it sees, declares COUNT of its own and
undeclares them, again and again until its input ends; then it prints how often it has done both.
NAMES are their owners: `live` (robots in their present lives), `lives` (robots in other lives),
`unknown` (robots that do not exist), `mixed` (a third of each), or `copies` (the very keys that
robots use).
"""

from __future__ import annotations

import os
import sys
import time

import zenoh

from benchmarks.flooder import input_ended, open_peer, report

KINDS = ("live", "lives", "unknown")
PAUSE_S = 0.01


def seen_tokens(session: zenoh.Session, team: str, count: int) -> list[list[str]]:
    """The keys of the first `count` robots' tokens that are seen, behind the team, in parts."""
    seen: dict[str, list[str]] = {}

    def see(sample: zenoh.Sample) -> None:
        robot, *rest = str(sample.key_expr).split("/")[3:]
        if robot != "observer":
            seen.setdefault(robot, [robot, *rest])

    callback = zenoh.handlers.Callback(see, indirect=False)
    subscriber = session.liveliness().declare_subscriber(
        f"mrbt/{team}/alive/**", callback, history=True
    )
    while len(seen) < count:
        time.sleep(PAUSE_S)
    subscriber.undeclare()
    return list(seen.values())


def key(kind: str, seen: list[list[str]], number: int, turn: int) -> str:
    """One token's key, behind the team: but for copies, that of a session that is new each time."""
    if kind == "mixed":
        kind = KINDS[number % len(KINDS)]
    parts = robot, counter, nonce, *_ = seen[number % len(seen)]
    if kind == "copies":
        return "/".join(parts)
    life = {
        "live": f"{robot}/{counter}/{nonce}",
        "lives": f"{robot}/{number + 2}/{number:x}",
        "unknown": f"Z{number}/1/{number:x}",
    }[kind]
    return f"{life}/{turn:x}x{number:x}/direct"


def main() -> None:
    """Show and drop tokens until the input ends."""
    count, kind, team, *endpoints = sys.argv[1:]
    os.nice(19)  # what it does on its own machine must not cost the team anything
    session = open_peer(endpoints)
    seen = seen_tokens(session, team, len(endpoints))
    rounds, ended = 0, input_ended()
    report("at it")
    while not ended.is_set():
        shown = [
            session.liveliness().declare_token(
                f"mrbt/{team}/alive/{key(kind, seen, number, rounds)}"
            )
            for number in range(int(count))
        ]
        for token in shown:
            token.undeclare()
        rounds += 1
    report(str(rounds))
    os._exit(0)


if __name__ == "__main__":
    main()
