"""What this robot's journal is known to hold: promises to others are made from the disk alone."""

from __future__ import annotations


class Durability:
    """Numbers what must be on disk, and knows up to where it is.

    `problem`: what is wrong with the journal, for people; empty if nothing is. `is_failing`: it
    cannot be written now.
    """

    def __init__(self, problem: str = "", is_failing: bool = False) -> None:
        self.problem = problem
        self.is_failing = is_failing
        self._last = 0
        self._synced = 0
        # Before this number is on disk, nothing else is known to be.
        self._whole_from = 0

    @property
    def may_promise(self) -> bool:
        """Whether what is written now will be on disk soon, with all that was said before."""
        return not self.is_failing and self._synced >= self._whole_from

    def take_number(self) -> int:
        """The number of what is written next."""
        self._last += 1
        return self._last

    def begin_anew(self) -> int:
        """The journal may have lost anything: the number of everything, written once more."""
        self._whole_from = self.take_number()
        return self._whole_from

    def note_synced(self, number: int) -> None:
        """Everything up to this number is on disk."""
        self._synced = max(self._synced, number)

    def is_on_disk(self, number: int) -> bool:
        """Whether this and all before it are on disk."""
        return self._synced >= max(number, self._whole_from)
