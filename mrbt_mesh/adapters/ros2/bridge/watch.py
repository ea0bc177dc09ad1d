"""Whether somebody is there: by signs of life, and by asking where there are none.

DDS tells that a server is gone after 20 s and later; a team wants to know in one.
"""

from __future__ import annotations

# So often is asked in the time in which a loss has to be noticed.
ASKS = 4
# Longer than DDS lists what belonged to a process that was killed (20 s by its default lease).
LISTED_S = 30.0


class LifeWatch:
    """Somebody who is there if it was heard within `detection_s`; `now_s` never goes back.

    Time in which this process itself stood still is nobody's silence.
    """

    def __init__(self, detection_s: float, now_s: float) -> None:
        self._detection_s = detection_s
        self._heard_s: float | None = None
        self._asked_s = now_s - detection_s
        self._ticked_s = now_s

    @property
    def is_there(self) -> bool:
        """Whether it was heard, and was not silent for too long since."""
        return self._heard_s is not None

    def heard(self, now_s: float) -> None:
        """A sign of life."""
        self._heard_s = now_s

    def gone(self) -> None:
        """It is known not to be there."""
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
    """Whether it counts that DDS lists somebody who cannot be asked; `now_s` never goes back.

    A node without parameter services cannot be asked, nor one whose name DDS does not tell. But
    after a node was killed and another one started, what is left of it may also have lost its
    name. So being listed counts where none of the nodes has answered within `LISTED_S`.
    """

    def __init__(self) -> None:
        self._answered_s: float | None = None

    def answered(self, now_s: float) -> None:
        """One of the nodes has answered a question."""
        self._answered_s = now_s

    def does_listing_count(self, now_s: float) -> bool:
        """Whether a node that is listed is taken for one that is there."""
        return self._answered_s is None or now_s - self._answered_s >= LISTED_S
