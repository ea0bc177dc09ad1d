"""The paper's story from one damage to the next: the team stands by, repairs, stands by again."""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.mission.names import split_call
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.observer.run_record import RunRecord
from paper.account import ROOT, AccountError, run

MISSION = ROOT / "examples" / "vehicle_repair" / "standing_by.yaml"
TIME_US = 90_000_000


@dataclass(frozen=True)
class Damage:
    """A damage and the round that it brought about; times in seconds, as the record counts them."""

    parts: tuple[str, ...]
    at_s: float
    took_s: float
    robots: tuple[str, ...]


def damages(seed: int) -> list[Damage]:
    """Every damage with its repair; raises AccountError if one was not repaired."""
    account = run(load_mission(MISSION), seed, timeout_us=TIME_US)
    record = account.record
    rounds = record.rounds.all
    if len(rounds) != 3 or any(each.result is not Status.SUCCESS for each in rounds):
        told = [each.result for each in rounds]
        raise AccountError(f"seed {seed}: three rounds that succeed expected, found {told}")
    found, since_us = [], 0
    for each in rounds:
        assert each.to_us is not None
        parts = _damaged(record, since_us, each.to_us)
        took_s = (each.to_us - each.from_us) / 1e6
        from_s = record.seconds(each.from_us)
        assert from_s is not None
        found.append(Damage(parts, from_s, took_s, tuple(sorted(each.robots))))
        since_us = each.to_us
    return found


def _damaged(record: RunRecord, from_us: int, to_us: int) -> tuple[str, ...]:
    """The parts that broke in that time."""
    calls = [
        split_call(name)
        for at_us, name, value in record.conditions
        if value and from_us < at_us < to_us
    ]
    return tuple(part for name, arguments in calls if name == "damaged" for part in arguments)
