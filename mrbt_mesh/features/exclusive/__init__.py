"""Tasks whose robots start together (`simultaneous`), and those that are never done by two groups
of robots at the same time, nor again (`exclusive`). Both are carried out by coalitions.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.feature import CommandField, Feature, Kit, Part
from mrbt_mesh.features.exclusive.fields import policy_of
from mrbt_mesh.features.exclusive.kinds import (
    BROKEN,
    CLEARED,
    COALITION,
    DECISION,
    DOUBT,
    GRANT,
    Decision,
)
from mrbt_mesh.features.exclusive.policy import CoalitionPolicy

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from mrbt_mesh.core.bt.evaluation import Request
    from mrbt_mesh.core.facts.records import Record
    from mrbt_mesh.core.facts.store import Entry
    from mrbt_mesh.core.facts.team_facts import TeamFacts
    from mrbt_mesh.core.mission.mission import GlobalTask
    from mrbt_mesh.core.planning.plan import Waiting
    from mrbt_mesh.features.exclusive.coalitions import Coalitions
    from mrbt_mesh.formats.mission_model import GlobalTaskModel
    from mrbt_mesh.formats.problems import Report, SourcePath
    from mrbt_mesh.sim.checkers.feature_checker import FeatureChecker
    from mrbt_mesh.sim.checkers.findings import RunFindings

# How operators consent to exclusive tasks that are begun again, on the command line.
REPEAT = "--repeat-exclusive"


class ExclusiveTasks(Feature):
    """The feature."""

    commands = {  # noqa: RUF012
        DECISION: CommandField(Decision, 3, is_of_activation=True, once=True)
    }
    kinds = dict.fromkeys((COALITION, BROKEN, GRANT, DOUBT, CLEARED), 3)
    has_joint_facts = True

    def mission_classes(self) -> Sequence[type]:
        return (CoalitionPolicy,)

    def file_fields(self) -> Mapping[str, Mapping[str, tuple[Any, FieldInfo]]]:
        from mrbt_mesh.features.exclusive.file_fields import FIELDS

        return FIELDS

    def build_joint(
        self, task: GlobalTaskModel, path: SourcePath, report: Report
    ) -> CoalitionPolicy | None:
        from mrbt_mesh.features.exclusive.file import build

        return build(task, path, report)

    def parse(self, kind: str, value: Any) -> Record:
        if kind == COALITION:
            from mrbt_mesh.features.exclusive.records import Coalition

            return Coalition.parse(value)
        from mrbt_mesh.core.facts.records import Latch

        return Latch.parse(value)

    def malformed(self, entry: Entry) -> str:
        from mrbt_mesh.features.exclusive.validation import id_problem

        return id_problem(entry.parts[-1])

    def refuses(self, entry: Entry, task: GlobalTask) -> str:
        from mrbt_mesh.features.exclusive.validation import refuses

        return refuses(entry, task)

    def objects_to_repeat(self, step: str) -> str:
        return (
            f"{step} is exclusive and was begun, and would be begun again: "
            f"leave its task and what guards it as they are, or use {REPEAT}"
        )

    def joint_facts(self) -> Coalitions:
        from mrbt_mesh.features.exclusive.coalitions import Coalitions

        return Coalitions()

    def would_help(
        self, facts: TeamFacts, waiting: Waiting, here: Collection[str]
    ) -> tuple[Collection[str], int]:
        from mrbt_mesh.features.exclusive.demands import would_help

        return would_help(facts, waiting, here)

    def parts(self, kit: Kit, before: Sequence[Part], now_us: int) -> Sequence[Part]:
        policies = [policy_of(task) for task in kit.context.mission.all_tasks()]
        joint = [policy for policy in policies if policy is not None]
        if not joint and not before:
            return ()
        from mrbt_mesh.features.exclusive.parts import parts

        return parts(kit, joint, before, now_us)

    def awaits_operator(self, facts: TeamFacts, request: Request) -> bool:
        from mrbt_mesh.features.exclusive.demands import awaits_operator

        return awaits_operator(facts, request)

    def checkers(self, run: RunFindings) -> Sequence[FeatureChecker]:
        from mrbt_mesh.features.exclusive.checker import BegunOnce, BegunTogether

        return BegunOnce(run), BegunTogether(run)


FEATURE = ExclusiveTasks()
