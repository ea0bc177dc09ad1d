"""How much of something may be done in a second."""

from __future__ import annotations


class Budget:
    """Lets `at_once` through, then `per_s` in each second. Times are in us."""

    def __init__(self, at_once: int, per_s: int, now_us: int) -> None:
        self._at_once = at_once
        self._per_s = per_s
        self._left = float(at_once)
        self._at_us = now_us

    def takes(self, now_us: int, amount: int = 1) -> bool:
        """Whether so much more may pass now."""
        gained = max(0, now_us - self._at_us) * self._per_s / 1e6
        self._left, self._at_us = min(self._at_once, self._left + gained), now_us
        if self._left < amount:
            return False
        self._left -= amount
        return True
