"""Whether this process computes by the plain definitions: MRBT_PLAIN=1."""

from __future__ import annotations

import os

from mrbt_mesh.core.engine import DEFINITIONS, FASTEST, Engine

VARIABLE = "MRBT_PLAIN"


def chosen_engine() -> Engine:
    """The definitions if the environment asks for them, else what is faster: the same answers."""
    return DEFINITIONS if os.environ.get(VARIABLE) == "1" else FASTEST
