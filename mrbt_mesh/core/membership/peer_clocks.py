"""What other robots' clocks reveal about this robot's own: whether it stood still for a time.

A virtual machine that is paused, copied or moved stops with all its clocks. The robot in it cannot
notice that by itself, but what it measures by its clock has gone on for others. So heartbeats carry
their sender's steady clock. Its offset from this robot's clock when the heartbeat arrives hardly
changes; it is reduced by the message's delay. If the offset jumps ahead, that time has passed for
the sender but not here, and whatever the sender answered before is older by that amount.
"""

from __future__ import annotations

from mrbt_mesh.core.membership.timing import Timing

# The fractions 1/n of elapsed time by which a clock may fall behind this robot's, and get ahead,
# without a jump: the drift of computer clocks, and the most that promises allow.
FALLS_BEHIND, GETS_AHEAD = 1_000, 3
# The number of jumps of one clock that are kept apart.
MAX_JUMPS = 16


class PeerClocks:
    """The clocks of the other robots, as their heartbeats show them. `changes` counts jumps.

    A jump is at least half of the time by which a promise outlasts the count of who has it.
    """

    def __init__(self, timing: Timing) -> None:
        self.changes = 0
        self._least_us = (timing.promise_us - timing.hold_us) // 2
        # Robot -> (its process, how far its clock is ahead, when it was last heard).
        self._known: dict[str, tuple[str, int, int]] = {}
        # Robot -> for each jump, (when it was found, how far the clock jumped ahead).
        self._jumps_us: dict[str, list[tuple[int, int]]] = {}

    def heard(self, robot: str, process: str, shows_us: int, now_us: int) -> int:
        """Note what a robot's clock shows now. Returns how far it has jumped ahead, or 0."""
        ahead_us, jump_us = shows_us - now_us, 0
        known = self._known.get(robot)
        if known is not None and known[0] == process:
            _, before_us, heard_us = known
            passed_us = max(0, now_us - heard_us)
            jump_us = ahead_us - before_us
            if jump_us >= self._least_us:
                self._note(robot, now_us, jump_us)
            else:
                # Messages that waited while the clock stood still arrive at once, each a little
                # ahead.
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
        """Return `at_us`, a time on this robot's clock, moved back by the other robot's later
        jumps.

        That is the time it would have shown had it kept pace with the other robot's clock since.
        """
        jumps_us = self._jumps_us.get(robot, ())
        return at_us - sum(jump_us for found_us, jump_us in jumps_us if found_us > at_us)

    def is_calm(self, robot: str, since_us: int) -> bool:
        """True if the robot's clock has not jumped at or after `since_us`."""
        jumps_us = self._jumps_us.get(robot)
        return not jumps_us or jumps_us[-1][0] < since_us

    def heard_us(self, robot: str) -> int | None:
        """When a heartbeat of the robot last arrived, None: never."""
        known = self._known.get(robot)
        return known[2] if known is not None else None
