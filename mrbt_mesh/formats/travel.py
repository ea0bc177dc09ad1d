"""Read `travel` of a mission file, and the places (`at`) of its local tasks."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from mrbt_mesh.core.mission.mission import JobType, Robot, travel_problems
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.mission.travel import MAX_PLACES, Travel
from mrbt_mesh.core.scheduling.problem import Objective
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.expand import (
    EntryArgument,
    LocalCalls,
    Placeholder,
    argument_text,
    check_references,
    micro_or_report,
    substitute,
)
from mrbt_mesh.formats.mission_map import places_on_map
from mrbt_mesh.formats.mission_model import MissionModel, TravelModel
from mrbt_mesh.formats.problems import Report, SourcePath

_EXAMPLE = "travel: {places: {dock: [0, 0]}, speed: 0.5, start: dock}"


class TravelBuilder:
    """Reads and checks what the file declares about places; problems go to the report."""

    def __init__(self, model: MissionModel, report: Report) -> None:
        self._model = model
        self._report = report
        self._at = {n: t.at for n, t in model.local_tasks.items() if t.at is not None}
        self._places: dict[str, tuple[int, int] | None] = {}
        self._ways_ms: dict[tuple[str, str], int] = {}
        self._speeds: dict[str, int] = {}
        if (travel := model.travel) is None:
            for name in self._at:
                message = f"travel is missing, which declares places, e.g. {_EXAMPLE}"
                report.add(("local_tasks", name, "at"), message)
            return
        if not self._at:
            message = "no local task happens at a place; give one, e.g. at: $place, or remove this"
            report.add(("travel",), message)
        self._read_places(travel)
        self._read_ways(travel)
        self._read_speeds(travel)
        self._check_start(travel)
        for name, at in self._at.items():
            place: SourcePath = ("local_tasks", name, "at")
            parameters = model.local_tasks[name].parameters
            check_references(at, frozenset(model.parameters) | {*parameters}, place, report)
            if "$" not in at and at in parameters and at not in self._places:
                report.add(place, f"{at!r} is not a place; write ${at} for the parameter")
            elif "$" not in at:
                self._check_place(at, place)

    @property
    def places(self) -> Collection[str]:
        """The declared places."""
        return self._places

    def of_job(self, job: JobType, local_tasks: LocalCalls) -> dict[str, str]:
        """Return the places of a job's local tasks, with placeholders.

        Every value that a job can give must be a place; others are reported and left out.
        """
        found = {}
        for ground, place in self._ground(local_tasks).items():
            path, of = ("local_tasks", type_name(ground), "at"), f"{ground} of {job.name}"
            if all(self._check_place(each, path, of) for each in job.values(place)):
                found[ground] = str(place)
        return found

    def build(
        self,
        robots: Mapping[str, Robot],
        local_tasks: LocalCalls,
        jobs: Iterable[JobType],
    ) -> Travel | None:
        """Return travel for these ground local tasks; None if none of them happens at a place."""
        travel = self._model.travel
        at = self._ground(local_tasks)
        if travel is None or not any((at, *(job.at for job in jobs))):
            return None
        given = travel.start
        start = dict.fromkeys(robots, given) if isinstance(given, str) else dict(given)
        found = Travel(
            self._places,
            at,
            start,
            self._speeds,
            self._ways_ms,
            Objective(travel.objective),
            travel.way_back == "start",
            travel.horizon,
            travel.overtaking,
        )
        for key, problem in travel_problems(found, robots.values(), jobs):
            self._report.add(("travel", key), problem)
        return found

    def _read_places(self, travel: TravelModel) -> None:
        report = self._report
        where: SourcePath = ("travel", "places")
        if travel.places is None:
            names = {*travel.ways, *(goal for goals in travel.ways.values() for goal in goals)}
            self._places = dict.fromkeys(sorted(names))
            if not names or len(names) > MAX_PLACES:
                message = f"1 to {MAX_PLACES} places are expected, found {len(names)}"
                report.add(("travel",), f"{message}; give places: {{dock: [0, 0]}}, or ways")
            return
        points: Mapping[str, list[float]]
        if travel.places == "map":
            points = places_on_map(self._model.parameters)
            where = ("parameters", "map", "places")
            if not points:
                message = "parameters: map has no places with coordinates (at most"
                report.add(("travel", "places"), f"{message} {MAX_PLACES})")
        else:
            points = travel.places
        for name, point in sorted(points.items()):
            here = (*where, name)
            try:
                argument_text(name)
            except ValueError as error:
                report.add(here, f"arguments name places, but {error}")
            x, y = (micro_or_report(value, here, report) for value in point)
            self._places[name] = (x, y)

    def _read_ways(self, travel: TravelModel) -> None:
        for origin, goals in travel.ways.items():
            here: SourcePath = ("travel", "ways", origin)
            self._check_place(origin, here)
            for goal, seconds in goals.items():
                there = (*here, goal)
                self._check_place(goal, there)
                if goal == origin:
                    self._report.add(there, "this is a way to where it begins; remove it")
                microseconds = micro_or_report(seconds, there, self._report)
                self._ways_ms[origin, goal] = -(-microseconds // 1_000)

    def _read_speeds(self, travel: TravelModel) -> None:
        types, here = self._model.robot_types, ("travel", "speed")
        if isinstance(travel.speed, float | int):
            speed = micro_or_report(travel.speed, here, self._report)
            self._speeds = dict.fromkeys(types, speed)
            return
        for kind, value in (travel.speed or {}).items():
            if kind not in types:
                message = f"unknown robot type {kind!r}{nearest(kind, types)}"
                self._report.add((*here, kind), message)
            self._speeds[kind] = micro_or_report(value, (*here, kind), self._report)

    def _check_start(self, travel: TravelModel) -> None:
        here: SourcePath = ("travel", "start")
        if isinstance(travel.start, str):
            self._check_place(travel.start, here)
            return
        for robot, place in travel.start.items():
            if robot not in self._model.robots:
                message = f"no robot {robot!r}{nearest(robot, self._model.robots)}"
                self._report.add((*here, robot), message)
            self._check_place(place, (*here, robot))

    def _check_place(self, name: str, path: SourcePath, of: str = "") -> bool:
        """Report an unknown place. Returns whether it is known.

        `of` is the ground local task that happens there, for the message.
        """
        if name not in self._places:
            message = f"{name!r} is not a declared place{nearest(name, self._places)}"
            self._report.add(path, f"{of}: {message}" if of else message)
        return name in self._places

    def _ground(self, local_tasks: LocalCalls) -> dict[str, str]:
        """Return the place of each of these local tasks that has one."""
        found = {}
        for ground, arguments in local_tasks.items():
            name = type_name(ground)
            if name not in self._at:
                continue
            path = ("local_tasks", name, "at")
            parameters = self._model.local_tasks[name].parameters
            bound = dict(zip(parameters, arguments, strict=True))
            try:
                place = argument_text(substitute(self._at[name], self._model.parameters | bound))
            except ValueError as error:
                self._report.add(path, f"{ground}: {error}")
                continue
            if isinstance(place, EntryArgument):
                message = f"a place is known from the start, but {place} only when it is read"
                self._report.add(path, f"{ground}: {message}; leave out at")
                continue
            if isinstance(place, Placeholder) or self._check_place(place, path, ground):
                found[ground] = place
        return found
