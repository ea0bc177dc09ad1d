"""The kinds of facts about coalitions. Their names are kind, activation, id of the coalition."""

from __future__ import annotations

import enum

# BROKEN: too few members are left. GRANT: the author has granted it a lease of an exclusive task.
# DOUBT: that lease has expired, and nobody knows how far the work got. CLEARED: its leader says
# that it never began. DECISION: an operator has decided about one in doubt.
COALITION, BROKEN, GRANT, DOUBT, CLEARED = "coalition", "broken", "grant", "doubt", "cleared"
DECISION = "decision"
COALITION_KINDS = frozenset({COALITION, BROKEN, GRANT, DOUBT, CLEARED, DECISION})
EXCLUSIVE_KINDS = frozenset({GRANT, DOUBT, CLEARED, DECISION})


class Decision(enum.StrEnum):
    """An operator's decision on a coalition that has left an exclusive task in doubt."""

    DONE = "done"
    FAILED = "failed"
    RETRY = "retry"
