"""Build the policies for lost contact from a mission file."""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.mission.mission import performance
from mrbt_mesh.features.contact.file_fields import LostContactModel
from mrbt_mesh.features.contact.policy import (
    MAX_MAJORITY,
    SECTION,
    ContactOf,
    LostContact,
    OnLostContact,
)
from mrbt_mesh.formats.expand import micro_or_report
from mrbt_mesh.formats.mission_model import MissionModel
from mrbt_mesh.formats.problems import Report


def build(
    model: MissionModel, robot_types: Mapping[str, Mapping[str, int]], report: Report
) -> dict[str, LostContact]:
    """Return what robots do without contact, by robot type; `go_on` is omitted."""
    found: dict[str, LostContact] = {}
    for name, entry in sorted(model.robot_types.items()):
        given: LostContactModel | None = getattr(entry, SECTION)
        path = ("robot_types", name, SECTION)
        if given is None:
            continue
        local_task, count = given.local_task or "", len(model.robots)
        if (given.then == "return") is not bool(local_task):
            hint = "`return: LOCAL_TASK` names what `then: return` performs"
            report.add(path, f"{hint}; give both or neither")
        elif local_task and performance(robot_types[name], local_task) is None:
            message = f"{name} cannot do {local_task!r}; it has {', '.join(robot_types[name])}"
            report.add((*path, "return"), message)
        if given.of != "operator" and count < 2:
            report.add(path, "the mission has no other robot to hear; use `of: operator`")
        elif given.of == "majority" and count > MAX_MAJORITY:
            message = f"of {count} robots each hears a few only; use `of: team` or `operator`"
            report.add((*path, "of"), message)
        after_us = micro_or_report(given.after_s, (*path, "after_s"), report)
        if given.then != "go_on":
            of, then = ContactOf(given.of), OnLostContact(given.then)
            found[name] = LostContact(after_us, of, then, local_task)
    return found
