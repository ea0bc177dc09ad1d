"""How much is tried: a part by default, all of it with MRBT_LONG=1, as `make test-long` does."""

from __future__ import annotations

import os

IS_LONG = bool(os.environ.get("MRBT_LONG"))


def seeds(many: int) -> range:
    """As many as a long test tries; the first tenth of them by default."""
    return range(many if IS_LONG else -(-many // 10))
