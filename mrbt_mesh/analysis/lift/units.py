"""Which parts of a single robot's tree can go to different robots: its units.

A unit is a node with all below it, or a run of neighbouring children of a Sequence, a Fallback or a
Parallel. One robot carries it out, with a blackboard of its own. Children stay in one unit if they
share what only a robot has: a blackboard entry that somebody writes, a condition or a resource with
`per: robot`. An action that declares nothing may need any of these, and whatever other such actions
leave behind, so these stay together as well. So do nodes that a team cannot decide: those with
conditions before or after them, those with rules or a memory of their own, and those behind a
condition that only the robot knows. Everything else is cut apart.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from mrbt_mesh.analysis.lift.carried import carried, may_skip
from mrbt_mesh.analysis.team_tree import KINDS
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.document import PRECONDITIONS, Category, pointer
from mrbt_mesh.btcpp.files.entries import EntryAccess, access, access_below
from mrbt_mesh.btcpp.files.expand import ExpandedNode, ExpandedTree
from mrbt_mesh.btcpp.files.library import Library

# What the team's tree decides. A time limit is one of a robot's work, and stays with the robot.
BETWEEN = frozenset(KINDS) - {"SequenceWithMemory", "Timeout", "SubTree"}
_LOOPS = frozenset({"RetryUntilSuccessful", "Repeat", "KeepRunningUntilFailure"})
_REACTIVE = frozenset({"ReactiveSequence", "ReactiveFallback", "WhileDoElse"})
_RUNS = frozenset({"Sequence", "AsyncSequence", "Fallback", "AsyncFallback"})
# They succeed when all that is in them has.
_ALL_OF_IT = frozenset({"Sequence", "AsyncSequence", "ReactiveSequence", "PipelineSequence"})
_ALL_OF_IT |= {"SequenceWithMemory", "RetryUntilSuccessful", "Timeout", "Delay"}
_ALWAYS = frozenset({"AlwaysSuccess", "AlwaysFailure"})

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
        """Take in child `number`, which uses it as in `other`."""
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


@dataclass(frozen=True, slots=True)
class HandUnit:
    """A unit by hand; several may have one name."""

    name: str
    number: int = 0


@dataclass(frozen=True)
class Knowledge:
    """The declarations of leaves in the team file.

    `is_asked`: whether a node is a condition that the whole team knows. `of_robots`: what a leaf
    needs, reads or changes that every robot has for itself. `by_hand`: the unit that a node was
    put into, by the node's identity. `independent`: the identities of nodes whose children the user
    has declared to be independent of one another.
    """

    is_asked: Callable[[ExpandedNode], bool] = lambda _: False
    of_robots: Callable[[ExpandedNode], Iterable[OwnUse]] = lambda _: ()
    by_hand: Mapping[int, HandUnit] = field(default_factory=dict)
    independent: Collection[int] = ()


@dataclass
class Piece:
    """A node of the team's tree: a unit of `nodes`, or one node that the team decides itself.

    `reasons`: why what is in the unit stays together. `cuts`: why its children may go to different
    robots, each with the names of both.
    """

    nodes: tuple[ExpandedNode, ...]
    is_unit: bool
    reasons: tuple[str, ...] = ()
    children: list[Piece] = field(default_factory=list)
    cuts: list[tuple[str, str, str]] = field(default_factory=list)

    def walk(self) -> Iterator[Piece]:
        """This piece and all below it, in preorder."""
        waiting = [self]
        while waiting:
            piece = waiting.pop()
            yield piece
            waiting.extend(reversed(piece.children))

    def units(self) -> list[Piece]:
        """The units in it, in order."""
        return [piece for piece in self.walk() if piece.is_unit]

    @property
    def label(self) -> str:
        """What it is called in explanations."""
        return label_of(self.nodes)


def label_of(nodes: Sequence[ExpandedNode]) -> str:
    """`Find`, or `Find to Carry`."""
    first, last = nodes[0].name, nodes[-1].name
    return first if len(nodes) == 1 else f"{first} to {last}"


def split(tree: ExpandedTree, library: Library, knowledge: Knowledge | None = None) -> Piece:
    """Cut a tree into its units."""
    return Splitter(tree, library, knowledge or Knowledge()).piece(tree.root)


class Splitter:
    """Splits one tree."""

    def __init__(self, tree: ExpandedTree, library: Library, knowledge: Knowledge) -> None:
        self.library = library
        self.knowledge = knowledge
        self.tree = tree
        self.written = access_below([tree.root], library).writes
        by_hand = [node for node in tree.root.walk() if id(node) in knowledge.by_hand]
        self.inside_by_hand = {id(inner) for node in by_hand for inner in node.walk()}

    # -- one node -------------------------------------------------------------------------------

    def piece(self, node: ExpandedNode) -> Piece:
        by_hand = self.knowledge.by_hand.get(id(node))
        if by_hand is not None:
            return Piece((node,), True, (f"it is the unit {by_hand.name!r} by hand",))
        if self.is_asked(node):
            return Piece((node,), False)
        reason = self.kept_whole(node)
        if reason or not node.children:
            return Piece((node,), True, (reason,) if reason else ())
        found = self.cut(node)
        if found.is_unit or len(found.children) > 1:
            return found
        (child,) = found.children
        if child.is_unit and len(child.nodes) == len(node.children):
            return Piece((node,), True, child.reasons)
        return found

    def is_asked(self, node: ExpandedNode) -> bool:
        """Whether the team knows it: a condition of the team file, or what never changes."""
        is_plain = not node.conditions and id(node) not in self.knowledge.by_hand
        return is_plain and (node.type in _ALWAYS or self.knowledge.is_asked(node))

    def kept_whole(self, node: ExpandedNode) -> str:
        """Why nothing in a node can go to another robot; empty if something might."""
        if not node.children:
            return ""
        for name in node.conditions:
            kind = "precondition" if name in PRECONDITIONS else "postcondition"
            return f"{node.name} has the {kind} {name}, which only its robot evaluates"
        if node.category is Category.SUBTREE:
            return _kept_subtree(node)
        if node.type not in BETWEEN:
            return f"{node.type} is carried out by one robot as a whole"
        fixed = self.tree.constants.keys() - self.written
        for entry in sorted(access(node, self.library).entries - fixed):
            return f"{node.name} reads the entry {self.key(entry, node)!r}"
        return ""

    # -- the children of one node ---------------------------------------------------------------

    def cut(self, node: ExpandedNode) -> Piece:
        """A node that the team decides, or one unit where that is impossible."""
        skipping = next((child for child in node.children if may_skip(child)), None)
        is_run = node.type in _RUNS or _needs_all(node)
        if skipping is not None and node.type not in _RUNS and len(node.children) > 1:
            return self.whole(node, f"{skipping.name} may be skipped, and no outcome reports that")
        groups = self.groups(node)
        if len(groups) == 1 and len(node.children) > 1:
            return Piece((node,), True, groups[0][1])
        if not is_run and len(groups) < len(node.children):
            reasons = tuple(reason for _, said in groups for reason in said)
            return Piece((node,), True, (*reasons, f"{node.type} has no part of its children"))
        children = [
            self.piece(members[0]) if len(members) == 1 else Piece(members, True, reasons)
            for members, reasons in groups
        ]
        reason = self.undecidable(node, children)
        if reason:
            return self.whole(node, reason)
        return Piece((node,), False, (), children, self.cuts(node, children))

    def whole(self, node: ExpandedNode, reason: str) -> Piece:
        return Piece((node,), True, (reason,))

    def undecidable(self, node: ExpandedNode, children: Sequence[Piece]) -> str:
        """Why the units that were found cannot be used; empty if they can."""
        guards = children[:1] if node.type == "WhileDoElse" else children[:-1]
        if node.type in _REACTIVE:
            for guard in guards:
                if guard.units():
                    return f"{node.type} asks {guard.label} at every tick, which only a robot can"
        if node.type in _LOOPS or node.type in _REACTIVE:
            for unit in (unit for child in children for unit in child.units()):
                reason = carried(unit.nodes, self.library)
                if reason:
                    return f"{node.type} begins {unit.label} more than once, and {reason}"
        return ""

    def cuts(self, node: ExpandedNode, children: Sequence[Piece]) -> list[tuple[str, str, str]]:
        found = []
        for one, other in pairwise(children):
            if one.units() and other.units():
                both = self.below(one).reads & self.below(other).reads
                names = sorted({self.key(entry, one.nodes[0]) for entry in both})
                also = f"; nobody writes {_listed(names)}, which both read" if both else ""
                by = self.declared_by(node, (one, other))
                reason = f"{by}, they share nothing of one robot; they share no entry{also}"
            else:
                known = other if one.units() else one
                reason = f"{known.label} is known to the whole team"
            found.append((one.label, other.label, reason))
        return found

    def declared_by(self, node: ExpandedNode, pieces: Iterable[Piece]) -> str:
        """Whose declaration allows a cut."""
        if id(node) in self.knowledge.independent:
            return f"{node.name} is declared to have independent children"
        by_hand = any(id(n) in self.inside_by_hand for each in pieces for n in each.nodes)
        return "as units by hand" if by_hand else "as declared"

    def below(self, piece: Piece) -> EntryAccess:
        return access_below(piece.nodes, self.library)

    # -- what stays together -------------------------------------------------------------------

    def groups(self, node: ExpandedNode) -> list[tuple[tuple[ExpandedNode, ...], tuple[str, ...]]]:
        """Neighbouring children that stay together, each group with its reasons."""
        children = node.children
        bonds = [
            *self.shared(children),
            *self.of_robots(node),
            *self.guarded(node),
            *self.joined(node),
        ]
        groups = []
        begin = 0
        while begin < len(children):
            end = index = begin
            while index <= end:
                end = max([end, *(last for first, last, _ in bonds if first == index)])
                index += 1
            said = [reason for first, _, reason in bonds if begin <= first <= end]
            groups.append((tuple(children[begin : end + 1]), tuple(dict.fromkeys(said))))
            begin = end + 1
        return groups

    def shared(self, children: Sequence[ExpandedNode]) -> Iterator[tuple[int, int, str]]:
        """The first and the last child that use the same, and what that is."""
        users: dict[tuple[str, str], list[int]] = {}
        accesses = [access_below([child], self.library) for child in children]
        is_unclear = any(found.writes_any for found in accesses)
        for number, found in enumerate(accesses):
            if is_unclear and (found.entries or found.writes_any):
                users.setdefault(("", ""), []).append(number)
            # What is only read, each robot can be given.
            for entry in sorted(found.entries & self.written):
                users.setdefault(("entry", entry), []).append(number)
        for (kind, name), numbers in users.items():
            if len(numbers) < 2:
                continue
            rows = [(children[number], accesses[number]) for number in numbers]
            reason = self.why(name, rows) if kind else _unclear(rows)
            yield numbers[0], numbers[-1], reason

    def of_robots(self, node: ExpandedNode) -> Iterator[tuple[int, int, str]]:
        """What of a robot children have to do with, as long as one hands it to the next."""
        users: dict[object, OwnUsers] = {}
        for number, child in enumerate(node.children):
            found: dict[object, OwnUsers] = {}
            for inner, is_certain in _with_certainty(child):
                for use in self.own_uses(inner, node):
                    own = found.setdefault(use.words, OwnUsers(use.words))
                    own.add(inner, use, is_certain)
                by_hand = self.knowledge.by_hand.get(id(inner))
                if by_hand is not None:
                    words = f"the unit {by_hand.name!r} by hand"
                    found.setdefault(by_hand, OwnUsers(words, is_declared=True, may_change=True))
            for key, own in found.items():
                if own.begins and key in users:
                    yield from users.pop(key).bonds(node.children)
                shared = users.setdefault(key, OwnUsers(own.words))
                shared.join(own, number)
                if own.ends:
                    yield from users.pop(key).bonds(node.children)
        for shared in users.values():
            yield from shared.bonds(node.children)

    def own_uses(self, leaf: ExpandedNode, parent: ExpandedNode) -> Iterator[OwnUse]:
        """What a leaf has to do with, as far as nobody has declared that it does not matter."""
        declared_by_hand = id(parent) in self.knowledge.independent or (
            id(leaf) in self.inside_by_hand and id(parent) not in self.inside_by_hand
        )
        for use in self.knowledge.of_robots(leaf):
            if use.is_declared or not declared_by_hand:
                yield use

    def why(self, entry: str, rows: Sequence[tuple[ExpandedNode, EntryAccess]]) -> str:
        """The writers and the readers of an entry."""
        parts = []
        for child, found in rows:
            does = "reads and writes" if entry in found.reads & found.writes else "writes"
            does = does if entry in found.writes else "reads"
            parts.append(f"{child.name} {does} it")
        return f"the entry {self.key(entry, rows[0][0])!r}: {', '.join(parts)}"

    def key(self, entry: str, node: ExpandedNode) -> str:
        """The name of an entry at a node."""
        return next(iter(node.scope.names_of(entry)), entry)

    def guarded(self, node: ExpandedNode) -> Iterator[tuple[int, int, str]]:
        """A condition that only its robot knows, and what it guards."""
        last = len(node.children) - 1
        if node.type == "Parallel":
            return
        for number, child in enumerate(node.children[:-1]):
            if not self.acts(child) and (leaf := self.robots_condition(child)) is not None:
                rest = _listed(each.name for each in node.children[number + 1 :])
                yield number, last, f"only its robot knows {leaf.name}, which decides about {rest}"

    def joined(self, node: ExpandedNode) -> Iterator[tuple[int, int, str]]:
        """What is no work for a robot by itself, or may be skipped, goes with its neighbour."""
        count = len(node.children)
        for number, child in enumerate(node.children):
            first, last = (number, number + 1) if number + 1 < count else (number - 1, number)
            if count < 2 or self.is_known(child):
                continue
            if not self.acts(child):
                yield first, last, f"{child.name} alone is no work for a robot"
            elif may_skip(child):
                yield first, last, f"{child.name} may be skipped, and no outcome reports that"

    def acts(self, node: ExpandedNode) -> bool:
        """Whether any action of the program is in it."""
        is_action = (
            each.category is Category.ACTION and each.type not in BUILTIN for each in node.walk()
        )
        return any(is_action) and not self.is_known(node)

    def is_known(self, node: ExpandedNode) -> bool:
        """Whether the team alone decides it."""
        if not node.children:
            return self.is_asked(node)
        whole = bool(self.kept_whole(node)) or id(node) in self.knowledge.by_hand
        return not whole and all(map(self.is_known, node.children))

    def robots_condition(self, node: ExpandedNode) -> ExpandedNode | None:
        """A condition in it that the team does not know."""
        for each in node.walk():
            if each.category is Category.CONDITION and not self.is_asked(each):
                return each
        return None


def _needs_all(node: ExpandedNode) -> bool:
    """Whether a Parallel succeeds with all, and fails with the first: parts of it may be nested."""
    is_default = node.ports.get("success_count", "-1") in ("-1", str(len(node.children)))
    return node.type == "Parallel" and is_default and node.ports.get("failure_count", "1") == "1"


def _kept_subtree(node: ExpandedNode) -> str:
    """A SubTree whose entries have no plain name inside cannot be taken apart."""
    scope = node.children[0].scope
    if len(set(scope.remapped.values())) < len(scope.remapped):
        return f"{node.name} has two names for one entry"
    if scope.autoremap and any(key != outer for key, outer in scope.remapped.items()):
        return f"{node.name} may have two names for one entry"
    for inner in node.walk():
        texts = [*inner.element.attributes.values()]
        if any("@" in (pointer(text) or "") for text in texts):
            return f"{inner.name} in it uses an entry of the outermost tree"
    return ""


def _with_certainty(node: ExpandedNode) -> Iterator[tuple[ExpandedNode, bool]]:
    """All nodes below, and whether each has been ticked to its end where `node` has succeeded."""
    waiting = [(node, True)]
    while waiting:
        inner, is_certain = waiting.pop()
        yield inner, is_certain
        passes = inner.type in _ALL_OF_IT or inner.category is Category.SUBTREE
        below = is_certain and passes and not inner.conditions
        waiting += [(child, below) for child in reversed(inner.children)]


def _unclear(rows: Sequence[tuple[ExpandedNode, EntryAccess]]) -> str:
    writer = next(child.name for child, found in rows if found.writes_any)
    return f"which entry {writer} writes is only known when it runs"


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)
