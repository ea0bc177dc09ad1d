"""Robots as bits of ints: sets of robots that cost next to nothing to intersect."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping


class RobotBits:
    """Robots as bits of ints. A robot that comes back gets another bit, and none is used twice.

    Masks of candidates are remembered by the identity of the mapping, which must not change.
    """

    def __init__(self, robots: Iterable[str] = ()) -> None:
        self._bits: dict[str, int] = {}
        self._masks: dict[int, tuple[Mapping[str, int], int]] = {}
        self.count = 0
        self.all = 0
        self.joined: list[tuple[str, int]] = []
        self.set(robots)

    def set(self, robots: Iterable[str]) -> bool:
        """These are the robots now, in the order in which they are to be taken; True: others."""
        known = self._bits
        names = robots if isinstance(robots, Mapping) else dict.fromkeys(robots)
        if names.keys() == known.keys():
            return False
        for robot in [robot for robot in known if robot not in names]:
            self.all ^= known.pop(robot)
        new = [robot for robot in names if robot not in known]
        for robot in new:
            known[robot] = 1 << self.count
            self.all |= known[robot]
            self.count += 1
            self.joined.append((robot, known[robot]))
        for robot in new:
            for key in [key for key, (some, _) in self._masks.items() if robot in some]:
                del self._masks[key]
        return True

    def bit(self, robot: str) -> int:
        """0 for one that is none of them."""
        return self._bits.get(robot, 0)

    def mask(self, candidates: Mapping[str, int]) -> int:
        """The robots among `candidates`; perhaps with bits of those that have left."""
        found = self._masks.get(id(candidates))
        if found is None:
            mask = self.of(candidates)
            if len(self._masks) > 4096:
                self._masks.clear()
            self._masks[id(candidates)] = (candidates, mask)
            return mask
        return found[1]

    def of(self, robots: Collection[str]) -> int:
        """The robots of these names."""
        bits, mask = self._bits, 0
        if len(robots) < 64:
            for robot in robots:
                mask |= bits.get(robot, 0)
            return mask
        digits = bytearray(b"0") * (self.count + 1)
        for robot in robots:
            digits[-bits.get(robot, 0).bit_length()] = 49  # "1"; the foremost digit is for no bit
        digits[0] = 48
        return int(digits, 2)
