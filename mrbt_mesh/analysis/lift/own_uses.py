"""What leaves of a tree have to do with things that every robot has for itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from mrbt_mesh.btcpp.files.expand import ExpandedNode

# What leaves that declare nothing may have to do with, besides what the team file names.
UNDECLARED = "what is not declared"


@dataclass(frozen=True, slots=True)
class OwnUse:
    """What a leaf has to do with something of its robot, named by `words`.

    `begins`: it does not matter what it was before; `ends`: it is left as it is at first.
    `is_declared`: whether the leaf declares this, or declares nothing and so may do it.
    `may_change`: False for a leaf that at most reads it.
    """

    words: str
    begins: bool = False
    ends: bool = False
    is_declared: bool = True
    may_change: bool = True


@dataclass
class OwnUsers:
    """The children that have to do with one thing of a robot.

    `undeclared`: leaves that declare nothing; `is_declared`: whether another one declares it.
    """

    words: str
    numbers: list[int] = field(default_factory=list)
    undeclared: dict[str, None] = field(default_factory=dict)
    is_declared: bool = False
    begins: bool | None = None
    ends: bool = False
    may_change: bool = False

    def add(self, leaf: ExpandedNode, use: OwnUse, is_certain: bool) -> None:
        """Take in the next leaf of one child."""
        if self.begins is None:
            self.begins = use.begins and is_certain
        self.ends = use.ends and is_certain
        self.may_change |= use.may_change
        self.is_declared |= use.is_declared
        if not use.is_declared:
            self.undeclared[leaf.name] = None

    def join(self, other: OwnUsers, number: int) -> None:
        """Take in child `number`, which uses it as `other` says."""
        self.numbers.append(number)
        self.undeclared |= other.undeclared
        self.is_declared |= other.is_declared
        self.may_change |= other.may_change

    def bonds(self, children: Sequence[ExpandedNode]) -> Iterator[tuple[int, int, str]]:
        """From the first child to the last, with the reason; none for a single one."""
        is_used = self.is_declared or self.words == UNDECLARED
        if len(self.numbers) < 2 or not self.may_change or not is_used:
            return
        names = ", ".join(self.undeclared)
        declares = f"{names} declare{'s' * (len(self.undeclared) == 1)} nothing"
        users = (children[number].name for number in self.numbers)
        reason = f"{self.words}: {', '.join(users)}"
        if self.words == UNDECLARED:
            reason = f"{declares}, so they are taken to depend on one another"
        elif self.undeclared:
            reason = f"{reason}; {declares} and may need it"
        yield self.numbers[0], self.numbers[-1], reason
