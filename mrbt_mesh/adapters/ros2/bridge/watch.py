"""Whether a process is alive: by signs of life, and by questions where there are none.

DDS reports that a server has ended after 20 s or later; a team needs to know within one.
"""

from __future__ import annotations

# Questions within the detection time.
ASKS = 4
# Longer than DDS lists a process that was killed (20 s by its default lease).
LISTED_S = 30.0


class LifeWatch:
    """Another process, alive if it was heard within `detection_s`; `now_s` never goes back.

    Time in which this process itself was stopped does not count as silence.
    """

    def __init__(self, detection_s: float, now_s: float) -> None:
        self._detection_s = detection_s
        self._heard_s: float | None = None
        self._asked_s = now_s - detection_s
        self._ticked_s = now_s

    @property
    def is_there(self) -> bool:
        """Whether it was heard within the detection time."""
        return self._heard_s is not None

    def heard(self, now_s: float) -> None:
        """A sign of life."""
        self._heard_s = now_s

    def gone(self) -> None:
        """It is known not to be alive."""
        self._heard_s = None

    def tick(self, now_s: float) -> bool:
        """Time has passed; returns whether it should be asked now."""
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
    """Whether a node that DDS lists, but that cannot be asked, counts as alive.

    A node without parameter services cannot be asked, nor one whose name DDS does not report. But
    an entry that is left of a killed node may have lost its name as well. So being listed counts
    only if none of the nodes has answered within `LISTED_S`. `now_s` never goes back.
    """

    def __init__(self) -> None:
        self._answered_s: float | None = None

    def answered(self, now_s: float) -> None:
        """One of the nodes has answered a question."""
        self._answered_s = now_s

    def does_listing_count(self, now_s: float) -> bool:
        """Whether a listed node counts as alive."""
        return self._answered_s is None or now_s - self._answered_s >= LISTED_S
