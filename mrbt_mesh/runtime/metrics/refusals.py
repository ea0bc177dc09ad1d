"""Why messages were refused, in few classes: reasons quote what came, labels must not."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.runtime.metrics.labels import OTHER, robot_label

# In this order; what fits none of them is malformed.
_CLASSES = (
    ("flood", r"too much to check"),
    ("replayed", r"said before"),
    ("misdirected", r"meant for somebody else|not meant for this member"),
    ("unsigned", r"^not signed$"),
    ("forged", r"signature is wrong|has no key|under the (name|key) of|may not say this"),
    ("forged", r"not signed by its author|another author"),
    ("incompatible", r"^(run|mission) '|wire schema|^signed: this team"),
)
MALFORMED = "malformed"
REASONS = (*dict.fromkeys(name for name, _ in _CLASSES), MALFORMED)


def reason_class(reason: str) -> str:
    """One of `REASONS`."""
    return next((name for name, text in _CLASSES if re.search(text, reason)), MALFORMED)


def refusals_by_class(mission: Mission, refused: Mapping[str, int]) -> Counter[tuple[str, str]]:
    """(source, class) -> how many, of what `AgentView.refused` counts."""
    found: Counter[tuple[str, str]] = Counter()
    for text, count in refused.items():
        source, _, reason = text.partition(": ")
        found[robot_label(mission, source), reason_class(reason) if reason else OTHER] += count
    return found
