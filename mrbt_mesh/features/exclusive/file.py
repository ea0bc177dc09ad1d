"""Build how coalitions carry out a task, from a mission file."""

from __future__ import annotations

from mrbt_mesh.features.exclusive.fields import InDoubtPolicy
from mrbt_mesh.features.exclusive.file_fields import (
    BEGIN_WITHIN_S,
    EXCLUSIVE,
    IN_DOUBT,
    SIMULTANEOUS,
)
from mrbt_mesh.features.exclusive.policy import CoalitionPolicy
from mrbt_mesh.formats.expand import micro_or_report
from mrbt_mesh.formats.mission_model import GlobalTaskModel
from mrbt_mesh.formats.problems import Report, SourcePath


def build(task: GlobalTaskModel, path: SourcePath, report: Report) -> CoalitionPolicy | None:
    """Return the policy of a task, at this path; None if its robots work each on its own."""
    simultaneous: bool = getattr(task, SIMULTANEOUS)
    exclusive: bool = getattr(task, EXCLUSIVE)
    within_s: float | None = getattr(task, BEGIN_WITHIN_S)
    in_doubt: str | None = getattr(task, IN_DOUBT)
    for name, value, owner, is_there in (
        (BEGIN_WITHIN_S, within_s, SIMULTANEOUS, simultaneous),
        (IN_DOUBT, in_doubt, EXCLUSIVE, exclusive),
    ):
        if value is not None and not is_there:
            text = f"{name} is for {owner} tasks; add {owner}: true or remove it"
            report.add((*path, name), text)
    if not (simultaneous or exclusive):
        return None
    within_us = None
    if within_s is not None:
        within_us = micro_or_report(within_s, (*path, BEGIN_WITHIN_S), report)
    policy = InDoubtPolicy(in_doubt or InDoubtPolicy.HOLD)
    return CoalitionPolicy(simultaneous, exclusive, policy, within_us)
