"""Side constraints: robots that may not work together, or at once (docs/how-to/constraints.md).

They go into the assignment problem of each plan, which CP-SAT then solves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.feature import Built, Feature
from mrbt_mesh.features.constraints.kinds import SECTION, Constraint, NeverTogether

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.features.constraints.chaos import ConstraintsChaos
    from mrbt_mesh.features.constraints.checker import KeepsConstraints
    from mrbt_mesh.features.constraints.limits import ConstraintLimits
    from mrbt_mesh.formats.mission_model import MissionModel
    from mrbt_mesh.formats.problems import Report
    from mrbt_mesh.sim.checkers.findings import RunFindings


class Constraints(Feature):
    """The feature. Its section holds the constraints, in the order of the file."""

    section = SECTION

    def section_type(self) -> Any:
        return tuple[Constraint, ...]

    def problem(self, section: Sequence[Constraint], mission: Mission) -> str | None:
        counts = (each.count for each in section if not isinstance(each, NeverTogether))
        return None if all(count > 0 for count in counts) else "constraint: a number from 1"

    def limits(self, section: Sequence[Constraint]) -> ConstraintLimits | None:
        from mrbt_mesh.features.constraints.limits import ConstraintLimits

        return ConstraintLimits(section) if section else None

    def file_fields(self) -> Mapping[str, Mapping[str, tuple[Any, FieldInfo]]]:
        from mrbt_mesh.features.constraints.file_fields import FIELDS

        return FIELDS

    def build(self, model: MissionModel, built: Built, report: Report) -> tuple[Constraint, ...]:
        from mrbt_mesh.features.constraints.file import build

        return build(model, built, report)

    def chaos(self, seed: int) -> ConstraintsChaos:
        from mrbt_mesh.features.constraints.chaos import ConstraintsChaos

        return ConstraintsChaos(seed)

    def allows(self, section: Sequence[Constraint], doers: Mapping[str, str]) -> bool:
        from mrbt_mesh.features.constraints.checker import allowed

        return all(allowed(constraint, doers) for constraint in section)

    def checkers(self, run: RunFindings) -> Sequence[KeepsConstraints]:
        from mrbt_mesh.features.constraints.checker import KeepsConstraints

        return (KeepsConstraints(run),)


FEATURE = Constraints()
