"""The declaration of an action: what it reads, changes and needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Declaration:
    """What one action does. Names are conditions or anything else that is read or written.

    `requires` must hold for it to succeed; with success `effects` hold, with failure they are as
    they were. `writes` are further things that it changes, or may have changed. `uses` are
    resources of which the team has one, for one action at a time. `may_fail`: even
    if all that it requires holds. `work` is its duration, in microseconds.
    """

    reads: frozenset[str] = frozenset()
    writes: frozenset[str] = frozenset()
    uses: frozenset[str] = frozenset()
    requires: Mapping[str, bool] = field(default_factory=dict)
    effects: Mapping[str, bool] = field(default_factory=dict)
    may_fail: bool = False
    work: int = 1_000_000

    @property
    def all_reads(self) -> frozenset[str]:
        return self.reads | self.requires.keys()

    @property
    def all_writes(self) -> frozenset[str]:
        return self.writes | self.effects.keys()
