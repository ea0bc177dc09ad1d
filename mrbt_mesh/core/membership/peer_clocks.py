"""What the clocks of other robots show of this robot's own: whether it stood still for a time.

A virtual machine that is paused, copied or moved stops with all its clocks. The robot in it cannot
know that by itself, but what it counts by its clock (the leases that it holds, its contact) has
gone on for others. So heartbeats say what their sender's steady clock shows. How far that is ahead
of this robot's, when the heartbeat arrives, hardly changes: it is less by what the message took. If
it jumps ahead, that time has passed for the sender and not here, and whatever the sender has
answered before is older by so much.
"""

from __future__ import annotations

from mrbt_mesh.core.membership.timing import Timing

# The shares of the time by which a clock may fall behind this robot's, and get ahead, without a
# jump: as clocks of computers drift, and as far as leases allow.
FALLS_BEHIND, GETS_AHEAD = 1_000, 3
# So many jumps of one clock are told apart.
MAX_JUMPS = 16


class PeerClocks:
    """The clocks of the other robots, as their heartbeats show them. `changes` counts jumps.

    A jump is at least half as long as the time by which a lease lasts longer than its holder counts
    on it.
    """

    def __init__(self, timing: Timing) -> None:
        self.changes = 0
        self._least_us = (timing.lease_us - timing.hold_us) // 2
        # Robot -> its process, how far its clock is ahead, and when it was heard.
        self._known: dict[str, tuple[str, int, int]] = {}
        # Robot -> when its clock was found to have jumped ahead, and how far.
        self._jumps_us: dict[str, list[tuple[int, int]]] = {}

    def heard(self, robot: str, process: str, shows_us: int, now_us: int) -> int:
        """The clock of this process of a robot shows this now; how far it has jumped ahead."""
        ahead_us, jump_us = shows_us - now_us, 0
        known = self._known.get(robot)
        if known is not None and known[0] == process:
            _, before_us, heard_us = known
            passed_us = max(0, now_us - heard_us)
            jump_us = ahead_us - before_us
            if jump_us >= self._least_us:
                self._note(robot, now_us, jump_us)
            else:
                # What has waited while the clock stood still comes at once: each a little ahead.
                ahead_us = min(ahead_us, before_us + passed_us // GETS_AHEAD)
                ahead_us = max(ahead_us, before_us - passed_us // FALLS_BEHIND)
        self._known[robot] = process, ahead_us, now_us
        return jump_us if jump_us >= self._least_us else 0

    def _note(self, robot: str, now_us: int, jump_us: int) -> None:
        self.changes += 1
        jumps_us = self._jumps_us.setdefault(robot, [])
        jumps_us.append((now_us, jump_us))
        if len(jumps_us) > MAX_JUMPS:
            (_, first_us), (at_us, second_us), *others_us = jumps_us
            jumps_us[:] = [(at_us, first_us + second_us), *others_us]

    def aged_us(self, robot: str, at_us: int) -> int:
        """When something would have been at which this robot's clock showed `at_us`, if it had
        gone on with that of another robot since.
        """
        jumps_us = self._jumps_us.get(robot, ())
        return at_us - sum(jump_us for found_us, jump_us in jumps_us if found_us > at_us)

    def is_calm(self, robot: str, since_us: int) -> bool:
        """Whether the clock of a robot has not jumped since, or just then."""
        jumps_us = self._jumps_us.get(robot)
        return not jumps_us or jumps_us[-1][0] < since_us

    def heard_us(self, robot: str) -> int | None:
        """When a heartbeat of a robot came last, None: never."""
        known = self._known.get(robot)
        return known[2] if known is not None else None
