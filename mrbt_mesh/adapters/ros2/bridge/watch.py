"""Tracks whether a process is alive, by signs of life and, if there are none, by requests.

DDS reports the end of a server after 20 s or later; a team needs to know within one second.
"""

from __future__ import annotations

# Number of requests within the detection time.
ASKS = 4
# Longer than DDS lists a killed process (20 s with its default lease).
LISTED_S = 30.0


class LifeWatch:
    """Watches another process, which is alive if it was heard within `detection_s`.

    `now_s` is monotonic. Time in which this process itself was stopped does not count as silence.
    """

    def __init__(self, detection_s: float, now_s: float) -> None:
        self._detection_s = detection_s
        self._heard_s: float | None = None
        self._asked_s = now_s - detection_s
        self._ticked_s = now_s

    @property
    def is_there(self) -> bool:
        """True if the process was heard within the detection time."""
        return self._heard_s is not None

    def heard(self, now_s: float) -> None:
        """Note a sign of life."""
        self._heard_s = now_s

    def gone(self) -> None:
        """Note that the process is not alive."""
        self._heard_s = None

    def tick(self, now_s: float) -> bool:
        """Advance the time. Returns whether a request should be sent now."""
        stood_still_s = now_s - self._ticked_s
        self._ticked_s = now_s
        pause_s = self._detection_s / ASKS
        if self._heard_s is not None:
            if stood_still_s > pause_s:
                self._heard_s = min(now_s, self._heard_s + stood_still_s)
            if now_s - self._heard_s >= self._detection_s:
                self._heard_s = None
        last_s = self._asked_s if self._heard_s is None else max(self._asked_s, self._heard_s)
        if now_s - last_s < pause_s:
            return False
        self._asked_s = now_s
        return True


class LifeAnswers:
    """Decides whether a node that DDS lists, but that cannot be asked, counts as alive.

    A node cannot be asked if it has no parameter services, or if DDS does not report its name. But
    the leftover entry of a killed node may have lost its name as well. So being listed counts only
    if none of the nodes has answered within `LISTED_S`. `now_s` is monotonic.
    """

    def __init__(self) -> None:
        self._answered_s: float | None = None

    def answered(self, now_s: float) -> None:
        """Note that one of the nodes has answered a request."""
        self._answered_s = now_s

    def does_listing_count(self, now_s: float) -> bool:
        """Return whether a listed node counts as alive."""
        return self._answered_s is None or now_s - self._answered_s >= LISTED_S
