"""What a run's record shows at one moment: robots, parts, cover and screws."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass

from mrbt_mesh.drills.physical import Span
from mrbt_mesh.observer.episodes import MajorFault, MinorFault
from paper.account import Account


class Part(enum.StrEnum):
    """What the team knows of a part; `REPAIRED` once its new wires are soldered."""

    UNKNOWN = "not diagnosed"
    IN_ORDER = "in order"
    BROKEN = "broken"
    REPAIRED = "repaired"


class Cover(enum.StrEnum):
    """Where the metal cover is."""

    ON = "on"
    GOING_OFF = "being taken off"
    OFF = "off"
    GOING_ON = "being put back"


class Screws(enum.StrEnum):
    """Where the cover's screws are."""

    IN = "in"
    GOING_OUT = "being taken out"
    OUT = "out"
    GOING_IN = "being put in"


@dataclass(frozen=True)
class Scene:
    """The vehicle and its team at `at_us` after the launch.

    `work` is what each robot at work does, `last` the part where each robot was last, or was
    about to be; `dead` and `lost` are the faults that the team knows of.
    """

    at_us: int
    team: Mapping[str, str]
    joined: frozenset[str]
    work: Mapping[str, Span]
    parts: Mapping[str, Part]
    cover: Cover
    screws: Screws
    dead: Mapping[str, MajorFault]
    lost: tuple[MinorFault, ...]
    last: Mapping[str, str]

    @property
    def resting(self) -> list[str]:
        """Robots that live and do nothing."""
        return [r for r in self.team if r in self.joined and r not in {*self.work, *self.dead}]

    def at_work(self, local_task: str) -> dict[str, str]:
        """Robot -> part of those that do this local task."""
        return {r: s.part for r, s in self.work.items() if s.local_task == local_task}


def moments(account: Account) -> list[int]:
    """Every moment at which the record changes, in microseconds, sorted."""
    found = {round(event["t"] * 1e6) for event in account.result.events}
    found |= set(account.record.joined_us.values())
    found |= {at_us for at_us, _, _ in account.record.conditions}
    found |= {f.at_us for f in account.record.minor}
    found |= {f.detected_us for f in account.record.major if f.detected_us is not None}
    found |= {f.until_us for f in account.record.major if f.until_us is not None}
    return sorted(found)


def scene(account: Account, at_us: int) -> Scene:
    """The scene right after everything that the record has for `at_us`."""
    record, at_s = account.record, at_us / 1e6
    begun = [s for s in account.spans if s.start_s <= at_s]
    dead = {
        f.robot: f
        for f in record.major
        if f.detected_us is not None
        and f.detected_us <= at_us
        and (f.until_us is None or f.until_us > at_us)
    }
    last = {s.robot: s.part for s in begun if s.part}
    for fault in dead.values():
        if fault.held is not None and "(" in fault.held.local_task:
            last[fault.robot] = fault.held.local_task.partition("(")[2].rstrip(")")
    work = {s.robot: s for s in begun if s.end_s > at_s}
    return Scene(
        at_us,
        {robot.id: robot.type for robot in account.mission.robots.values()},
        frozenset(r for r, since_us in record.joined_us.items() if since_us <= at_us),
        work,
        _parts(account, at_us),
        _cover(account, at_us, work),
        _screws(account, at_us, work),
        dead,
        tuple(
            f
            for f in record.minor
            if f.at_us <= at_us and (f.until_us is None or f.until_us > at_us)
        ),
        last,
    )


def _done(account: Account, global_task: str, at_us: int) -> bool:
    """Whether by then enough robots had succeeded with each local task of the global task."""
    successes = [
        s.ground
        for s in account.spans
        if s.global_task == global_task and s.end == "success" and s.end_s <= at_us / 1e6
    ]
    needs = account.mission.global_tasks[global_task].needs
    return all(successes.count(need.local_task) >= need.min_robots for need in needs)


def _parts(account: Account, at_us: int) -> dict[str, Part]:
    broken: dict[str, bool] = {}
    for since_us, name, value in account.record.conditions:
        if since_us <= at_us:
            broken[name] = bool(value)
    parts = {}
    for number in map(str, account.mission.parameters["parts"]):
        if not _done(account, f"diagnose_part({number})", at_us):
            parts[number] = Part.UNKNOWN
        elif not broken.get(f"broken({number})", False):
            parts[number] = Part.IN_ORDER
        elif _done(account, f"solder({number})", at_us):
            parts[number] = Part.REPAIRED
        else:
            parts[number] = Part.BROKEN
    return parts


def _cover(account: Account, at_us: int, work: Mapping[str, Span]) -> Cover:
    moved_for = {s.global_task for s in work.values() if s.local_task == "move_frame"}
    if moved_for:
        return Cover.GOING_OFF if "remove_cover" in moved_for else Cover.GOING_ON
    is_off = _done(account, "remove_cover", at_us) and not _done(account, "place_cover", at_us)
    return Cover.OFF if is_off else Cover.ON


def _screws(account: Account, at_us: int, work: Mapping[str, Span]) -> Screws:
    turned_for = {s.global_task for s in work.values() if s.local_task == "use_screwdriver"}
    if turned_for:
        return Screws.GOING_OUT if "remove_screws" in turned_for else Screws.GOING_IN
    is_out = _done(account, "remove_screws", at_us) and not _done(account, "place_screws", at_us)
    return Screws.OUT if is_out else Screws.IN
