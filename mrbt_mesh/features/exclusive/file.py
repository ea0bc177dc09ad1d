"""Build how coalitions carry out a task, from a mission file."""

from __future__ import annotations

from mrbt_mesh.features.exclusive.fields import InDoubtPolicy
from mrbt_mesh.features.exclusive.policy import CoalitionPolicy
from mrbt_mesh.formats.expand import micro_or_report
from mrbt_mesh.formats.mission_model import GlobalTaskModel
from mrbt_mesh.formats.problems import Report, SourcePath


def build(task: GlobalTaskModel, path: SourcePath, report: Report) -> CoalitionPolicy | None:
    """Return the policy of a task, at this path; None if its robots work each on its own."""
    if not (task.simultaneous or task.exclusive):
        return None
    within_s, in_doubt = task.begin_within_s, task.in_doubt or InDoubtPolicy.HOLD
    return CoalitionPolicy(
        task.simultaneous,
        task.exclusive,
        InDoubtPolicy(in_doubt),
        None if within_s is None else micro_or_report(within_s, (*path, "begin_within_s"), report),
    )
