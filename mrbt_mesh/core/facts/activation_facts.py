"""The facts of one activation: the index that task statuses and plans read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from mrbt_mesh.core.bt.activation import Activation
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    Arguments,
    Attempt,
    ChildResult,
    Outcome,
)
from mrbt_mesh.core.facts.store import Entry, Version
from mrbt_mesh.core.feature import JointFacts, features

# Local task -> robot -> success.
Outcomes: TypeAlias = Mapping[str, Mapping[str, bool]]
# The feature that has facts about parties, and the kinds of these.
OF_PARTIES = next((feature for feature in features() if feature.has_joint_facts), None)
PARTY_KINDS = frozenset(OF_PARTIES.activation_kinds() if OF_PARTIES is not None else ())


@dataclass(slots=True)
class ActivationFacts:
    """All entries of one activation. They are dropped together.

    `keys`: (author, name) of its entries. `joint`: None until an entry is about a party; from then
    on it holds the outcomes, which are in `outcomes` otherwise. `child_results`: position of the
    child -> success. `begun_with`: (stamp, author, values) that count for the entries that its task
    reads. `outcomes` is replaced when it changes, never altered.
    """

    activation: Activation
    keys: dict[tuple[str, str], None] = field(default_factory=dict)
    outcomes: Outcomes = field(default_factory=dict)
    joint: JointFacts | None = None
    attempts_used: int = 0
    child_results: dict[int, bool] = field(default_factory=dict)
    has_latched_failure: bool = False
    has_expired: bool = False
    begun_with: tuple[int, str, tuple[str, ...]] | None = None

    def add(self, entry: Entry) -> None:
        """Add one of its entries."""
        self.keys[entry.author, entry.name] = None
        parts, record = entry.parts, entry.record
        kind = parts[0]
        if kind in PARTY_KINDS:
            self._with_joint().add(entry)
        elif isinstance(record, Outcome):
            self.add_outcome(parts, entry.author, record.success, entry.version)
        elif isinstance(record, Attempt):
            self.attempts_used = max(self.attempts_used, record.number)
        elif isinstance(record, ChildResult):
            position = int(parts[2])
            self.child_results[position] = record.success or self.child_results.get(position, False)
        elif isinstance(record, Arguments):
            found = (record.stamp, entry.author, record.values)
            self.begun_with = min(found, self.begun_with or found)
        elif kind == records.LATCHED_FAILURE:
            self.has_latched_failure = True
        elif kind == records.EXPIRED:
            self.has_expired = True

    def add_outcome(
        self, parts: tuple[str, ...], robot: str, success: bool, version: Version
    ) -> None:
        """Add an outcome. `parts`: the parts of its name, the last of which may be a party."""
        local_task = parts[2]
        if len(parts) == 4:
            self._with_joint().add_outcome(parts[3], local_task, robot, success, version)
        else:
            ends = {**self.outcomes.get(local_task, {}), robot: success}
            self.outcomes = {**self.outcomes, local_task: ends}

    def _with_joint(self) -> JointFacts:
        if self.joint is None:
            assert OF_PARTIES is not None  # nobody else names a party
            self.joint = OF_PARTIES.joint_facts()
        return self.joint

    def stamp_of(self, entry: Entry) -> int:
        """The Lamport stamp in the name of one of its entries; 0 if it has none."""
        if self.joint is None or entry.parts[0] not in PARTY_KINDS:
            return 0
        return self.joint.stamp_of(entry)

    @property
    def verdict(self) -> bool | None:
        """Success or failure, if an operator has decided how it ended."""
        return self.joint.verdict if self.joint is not None else None

    @property
    def has_outcome(self) -> bool:
        """True if some robot has an outcome here."""
        return bool(self.outcomes) or (self.joint is not None and self.joint.has_outcome)
