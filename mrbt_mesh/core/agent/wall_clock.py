"""What time it is: this robot's wall clock, compared with those of the others.

Heartbeats carry their sender's wall clock. The team's time is the median of the clocks of the
robots that are heard, including this one; of an even number the earlier one in the middle, so that
a clock that is ahead makes nothing happen too early. A robot whose clock is off by more than
`TOLERANCE_US` reports that, and leaves it to others to write that a time has come.

A robot that hears no other keeps its last comparison until its own clock is set. A robot that is
alone from the start uses its own clock.
"""

from __future__ import annotations

from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.timing import earlier_median

TOLERANCE_US = 1_000_000
# The runtime reads the clock again once it is off by this much from the last reading.
READ_AGAIN_US = 50_000


class WallClock:
    """One robot's wall clock.

    `is_believed`: it is close enough to the team's time to decide that a time has come. `problem`:
    a text on how far it is off; empty if it is not.
    """

    def __init__(self, membership: Membership, period_us: int) -> None:
        self.is_believed = False
        self.problem = ""
        self._membership = membership
        self._period_us = period_us
        self._offset_us: int | None = None
        # By how much it is ahead of the team's time; and the value shown in the problem.
        self._ahead_us = self._shown_us = 0
        self._is_compared = False
        # When it is next compared, unless the members change.
        self._next_us = 0
        self._member_changes = -1

    def read(self, offset_us: int, now_us: int) -> None:
        """Note that the clock shows `offset_us` more than the time of the inputs.

        If it was set, or the clock of the inputs jumped, it must be compared anew.
        """
        before_us, self._offset_us = self._offset_us, offset_us
        if before_us is None or abs(offset_us - before_us) > TOLERANCE_US:
            self._membership.forget_clocks()
            self.is_believed = self._is_compared = False
            self._ahead_us = 0
        self._next_us = now_us

    def unix_us(self, now_us: int) -> int | None:
        """The time that it shows; None before it was read."""
        return None if self._offset_us is None else max(0, now_us + self._offset_us)

    def team_us(self, now_us: int) -> int | None:
        """The team's time by the last comparison; None before the clock was read."""
        return None if self._offset_us is None else now_us + self._offset_us - self._ahead_us

    def when_us(self, unix_us: int) -> int | None:
        """The time of the inputs at which it shows `unix_us`; None if it is not believed."""
        if self._offset_us is None or not self.is_believed:
            return None
        return unix_us - self._offset_us

    def compare(self, now_us: int) -> bool:
        """Compare the clock with the others', once per heartbeat. Returns whether `is_believed` or
        the problem has changed.
        """
        membership, changes = self._membership, self._membership.member_changes
        if self._offset_us is None or (now_us < self._next_us and changes == self._member_changes):
            return False
        self._next_us, self._member_changes = now_us + self._period_us, changes
        others_us = membership.clock_offsets_us()
        if others_us:
            self._is_compared = True
            self._ahead_us = self._offset_us - earlier_median([self._offset_us, *others_us])
        before = self.is_believed, self._shown_us
        is_known = self._is_compared or not membership.joined_count
        self.is_believed = is_known and abs(self._ahead_us) <= TOLERANCE_US
        if self.is_believed:
            self._shown_us, self.problem = 0, ""
        elif before[0] or not is_known:
            pass  # reported if found again: heartbeats may have waited to be read
        elif not self._shown_us or abs(self._ahead_us - self._shown_us) > TOLERANCE_US:
            self._shown_us, self.problem = self._ahead_us, _problem(self._ahead_us)
        return before != (self.is_believed, self._shown_us)


def _problem(ahead_us: int) -> str:
    side = "ahead of" if ahead_us > 0 else "behind"
    seconds = (abs(ahead_us) + 500_000) // 1_000_000
    return (
        f"its clock is {seconds} s {side} the team's, so it does not decide when jobs are "
        "due or expire: set the clock, or have it set by NTP"
    )
