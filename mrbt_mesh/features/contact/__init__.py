"""Robots without contact with their team (`on_lost_contact`), and robots that operators borrow.

Both withdraw a healthy robot from the team's work (`withdrawal`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.feature import Built, CommandField, Feature, Index, Kit, Part
from mrbt_mesh.features.contact.loans import BORROWED, Loan, Loans
from mrbt_mesh.features.contact.policy import (
    MAX_CONTACT_US,
    SECTION,
    LostContact,
    OnLostContact,
    policies,
)

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.features.contact.chaos import ContactChaos
    from mrbt_mesh.features.contact.checker import HasStopped
    from mrbt_mesh.formats.mission_model import MissionModel
    from mrbt_mesh.formats.problems import Report
    from mrbt_mesh.sim.checkers.findings import RunFindings


class Contact(Feature):
    """The feature. Its section maps robot types to `LostContact`."""

    section = SECTION
    commands = {BORROWED: CommandField(Loan, 2, is_of_robot=True)}  # noqa: RUF012

    def section_type(self) -> Any:
        return Mapping[str, LostContact]

    def problem(self, section: Mapping[str, LostContact], mission: Mission) -> str | None:
        from mrbt_mesh.core.mission.mission import performance

        for kind, lost in section.items():
            is_known = kind in mission.robot_types
            returns = lost.then is OnLostContact.RETURN
            able = performance(mission.robot_types.get(kind, {}), lost.local_task) is not None
            if not is_known or not 1 <= lost.after_us <= MAX_CONTACT_US or able is not returns:
                return f"robot type {kind}: lost contact"
        return None

    def stops_in_time(self, section: Mapping[str, LostContact]) -> bool:
        return any(policy.is_promise for policy in section.values())

    def file_fields(self) -> Mapping[str, Mapping[str, tuple[Any, FieldInfo]]]:
        from mrbt_mesh.features.contact.file_fields import FIELDS

        return FIELDS

    def build(self, model: MissionModel, built: Built, report: Report) -> Mapping[str, LostContact]:
        from mrbt_mesh.features.contact.file import build

        return build(model, built.robot_types, report)

    def index(self, mission: Mission) -> Index:
        return Loans()

    def parts(self, kit: Kit, before: Sequence[Part], now_us: int) -> Sequence[Part]:
        from mrbt_mesh.features.contact.borrowing import Borrowing

        borrowing = next((part for part in before if isinstance(part, Borrowing)), None)
        borrowing = borrowing or Borrowing(kit)
        if not policies(kit.context.mission):
            return (borrowing,)
        from mrbt_mesh.features.contact.watch import ContactWatch

        return borrowing, ContactWatch(kit, borrowing.withdrawal, now_us)

    def chaos(self, seed: int) -> ContactChaos:
        from mrbt_mesh.features.contact.chaos import ContactChaos

        return ContactChaos(seed)

    def checkers(self, run: RunFindings) -> Sequence[HasStopped]:
        from mrbt_mesh.features.contact.checker import HasStopped

        return (HasStopped(run),)


FEATURE = Contact()
