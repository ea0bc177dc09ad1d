"""The names of what missions and facts say of revisions, and their limits."""

from __future__ import annotations

# What a compiled mission says of itself as a revision.
SECTION = "revision"
# Fields of commands, by the number of the revision: it is proposed; its proposal is withdrawn.
MISSION, MISSION_WITHDRAWN = "mission", "mission_withdrawn"
# It is in force, by its number; which one the author holds.
MISSION_ADOPTED, MISSION_HELD = "mission_adopted", "mission_held"
KINDS = frozenset({MISSION, MISSION_WITHDRAWN, MISSION_ADOPTED, MISSION_HELD})
# The largest length of a compiled mission, in characters.
MAX_MISSION = 250_000
# The most digits of a revision number.
MAX_DIGITS = 9
