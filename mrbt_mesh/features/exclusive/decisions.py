"""How a robot takes operators' decisions about exclusive tasks in doubt."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.operator_desk import FieldRule, RefusalError, Rules
from mrbt_mesh.core.agent.operator_messages import CONFLICT, UNKNOWN
from mrbt_mesh.core.facts.records import OPERATORS, OperatorCommand
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.features.exclusive.coalitions import coalitions_of, grantors
from mrbt_mesh.features.exclusive.kinds import DECISION


def decision_rules(context: Context) -> Rules:
    """The rule of decisions about exclusive tasks in doubt."""
    facts = context.facts

    def decided(subject: str) -> dict[str, Any]:
        held = facts.map.get(OPERATORS, f"{DECISION}/{subject}")
        command = held.record if held is not None else None
        if not isinstance(command, OperatorCommand):
            return {"decision": ""}
        return {"decision": str(command.value), "by": command.operator}

    def known(entry: Entry) -> bool:
        held = facts.map.get(OPERATORS, entry.name)
        if held is None:
            return False
        found, wanted = held.record, entry.record
        assert isinstance(found, OperatorCommand)
        assert isinstance(wanted, OperatorCommand)
        if found.value != wanted.value:
            raise RefusalError(f"{found.operator} has decided already: {found.value}", CONFLICT)
        return True

    def check(entry: Entry, _: int) -> None:
        activation, coalition = entry.parts[1:]
        doubted = coalitions_of(facts, activation).in_doubt(grantors(facts))
        if coalition not in map(str, doubted):
            raise RefusalError(f"{activation} is not in doubt (any more)", UNKNOWN)

    return {DECISION: FieldRule(decided, check, known)}
