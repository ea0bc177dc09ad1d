"""Deliberate bugs of the feature: each must break its invariant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.membership.replica import Replica
from mrbt_mesh.core.mission.mission import GlobalTask
from mrbt_mesh.features.exclusive import coalitions, demands, leases
from mrbt_mesh.features.exclusive.coalition_begin import BeginWatch
from mrbt_mesh.features.exclusive.coalitions import Coalitions, coalitions_of
from mrbt_mesh.features.exclusive.kinds import GRANT
from mrbt_mesh.features.exclusive.leases import LeaseGrantor


def _true(*_: Any, **__: Any) -> bool:
    return True


def _has_enough(
    original: Any,
    facts: Any,
    task: Any,
    activation: str,
    token: Any,
    alive: Mapping[str, Incarnation] | None,
) -> bool:
    members = coalitions_of(facts, activation).members[token]
    if alive is not None:
        lives = {m.robot: Incarnation(m.counter, m.nonce) for m in members}
        alive = {robot: lives.get(robot, life) for robot, life in alive.items()}
    return bool(original(facts, task, activation, token, alive))


def _restore_no_grants(original: Any, mine: Replica, entries: Sequence[Entry]) -> None:
    original(mine, [e for e in entries if not e.name.startswith(f"{GRANT}/")])


def _init_and_grant(original: Any, mine: LeaseGrantor, *given: Any) -> None:
    original(mine, *given)
    mine.end_silence()


def _succeed_together(_: Any, mine: Coalitions, task: GlobalTask) -> bool:
    outcomes = mine.outcomes.values()
    return mine.verdict is True or all(
        sum(sum(found.get(n.local_task, {}).values()) for found in outcomes) >= n.min_robots
        for n in task.needs
    )


MUTANTS = {
    # One grant is enough for an exclusive task.
    "exclusive_without_majority": [
        (module, "majority", lambda *_: 1) for module in (coalitions, leases, demands)
    ],
    # What a coalition did counts whenever its members began.
    "partners_may_be_late": (BeginWatch, "_have_all_begun", _true),
    # The claim of an earlier life still holds its robot in a coalition. (That of a robot without
    # coalition ends with the batch with which its next life joins.)
    "stale_claims_stay_valid": [
        (coalitions, "_has_enough", _has_enough),
        (coalitions, "is_still_in", _true),
        (demands, "is_still_in", _true),
    ],
    # A robot forgets its grants when it starts again, and grants at once.
    "grants_not_synced": [
        (Replica, "restore", _restore_no_grants),
        (LeaseGrantor, "__init__", _init_and_grant),
    ],
    # Successes of different coalitions count together.
    "rounds_are_mixed": (Coalitions, "has_succeeded", _succeed_together),
}
