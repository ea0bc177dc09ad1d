"""From a single robot's tree to a team's: actions become global tasks, what may, goes in parallel.

Source: paper, section V-A. Each action alpha_k becomes a global task with psi = {alpha_k} and
nu = mu = 1; a Sequence becomes Parallel(M=N) and a Fallback Parallel(M=1) where that is allowed.
It is allowed where no run of the team's tree can end otherwise than the single robot's: of two
children of a Sequence neither touches what the other writes, they share no resource, and none
of them can fail while the other changes something (the single robot would have stopped there);
of two children of a Fallback, besides, both change nothing: alternatives that act on the world are
tried in turn, as the single robot does (the paper's large and small screwdriver).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from mrbt_mesh.analysis.lift.arrange import Arrangement, Pair, Parallel, arrange, closure
from mrbt_mesh.analysis.lift.effects import (
    Declarations,
    EffectSummary,
    Ends,
    Known,
    ends,
    guards,
    summary,
    without,
)
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.formats.declaration import Declaration
from mrbt_mesh.formats.node_paths import child_path, label, root_path


@dataclass(frozen=True, slots=True)
class Dependence:
    """Why one child of a node has to come before another; `path` is that of the node."""

    first: str
    second: str
    reason: str
    is_added: bool = False


@dataclass(frozen=True, slots=True)
class LiftDecision:
    """What became of one Sequence or Fallback, by its path: `after` draws the arrangement."""

    path: str
    kind: str
    before: tuple[str, ...]
    after: str
    dependences: tuple[Dependence, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def is_parallel(self) -> bool:
        """Whether anything of it may now happen at the same time."""
        return "|" in self.after


@dataclass(frozen=True)
class Lifted:
    """The team's tree, what was decided, and times in microseconds if nothing fails.

    `serial_us` is what one robot needs, `critical_us` a team that is large enough.
    """

    tree: NodeSpec
    decisions: tuple[LiftDecision, ...]
    serial_us: int
    critical_us: int

    @property
    def factor(self) -> float:
        """How many times faster a team can be at most."""
        return self.serial_us / self.critical_us if self.critical_us else 1.0


@dataclass
class Lifter:
    """Lifts one tree. `independent` are paths of nodes whose children do not depend on one
    another, as the user has declared: actions there that declare nothing are no obstacle.
    """

    declared: Declarations
    work_us: Mapping[str, int] = field(default_factory=dict)
    independent: Collection[str] = ()
    decisions: list[LiftDecision] = field(default_factory=list)

    def lift(self, spec: NodeSpec) -> Lifted:
        """The team's tree of a single robot's."""
        tree = self._lifted(spec, root_path(spec), {}, frozenset(), True)
        return Lifted(
            tree,
            tuple(self.decisions),
            working_time_us(spec, self.work_us, is_serial=True),
            self._critical_us(tree),
        )

    def _critical_us(self, spec: NodeSpec) -> int:
        return working_time_us(spec, self.work_us, is_serial=False)

    def _lifted(
        self, spec: NodeSpec, path: str, known: Known, guarding: frozenset[str], may: bool
    ) -> NodeSpec:
        """`guarding`: conditions that nodes above ask at every tick. `may`: nothing above stops
        the node halfway at a time that depends on how fast it is.
        """
        if not spec.children:
            return spec
        flat = _flat(spec, path, self.independent) if may else spec
        if flat == spec:
            return self._lifted_as_it_is(spec, path, known, guarding, may)
        start = len(self.decisions)
        kept = self._lifted_as_it_is(spec, path, known, guarding, may)
        decided = self.decisions[start:]
        del self.decisions[start:]
        taken_apart = self._lifted_as_it_is(flat, path, known, guarding, may)
        if self._critical_us(taken_apart) < self._critical_us(kept):
            note = "what is nested in it was taken apart: that shortens the longest chain"
            last = self.decisions[start]
            self.decisions[start] = replace(last, notes=(*last.notes, note))
            return taken_apart
        self.decisions[start:] = decided
        return kept

    def _lifted_as_it_is(
        self, spec: NodeSpec, path: str, known: Known, guarding: frozenset[str], may: bool
    ) -> NodeSpec:
        inner = guarding | guards(spec)
        befores = self._known_before(spec, known)
        arrangement: Arrangement | None = None
        if spec.kind in (Kind.SEQUENCE, Kind.FALLBACK) and len(spec.children) > 1:
            if may:
                arrangement, befores = self._arranged(spec, path, known, inner)
            else:
                note = "a Timeout or a Parallel above may stop it halfway: left as it is"
                self._decide(spec, path, None, (), (note,))
        outcomes = [ends(c, b, self.declared) for c, b in zip(spec.children, befores, strict=True)]
        children = tuple(
            self._lifted(
                child,
                child_path(path, spec, position),
                before,
                inner,
                may and not _may_stop(spec, position, outcomes),
            )
            for position, (child, before) in enumerate(zip(spec.children, befores, strict=True))
        )
        if arrangement is None or _is_as_before(arrangement, len(children)):
            return replace(spec, children=children)
        return _built(arrangement, spec, children, is_top=True)

    def _known_before(self, spec: NodeSpec, known: Known) -> list[Known]:
        """What is known before each child is begun, in the single robot's run."""
        if spec.kind is Kind.IF_THEN_ELSE:
            asked = ends(spec.children[0], known, self.declared)
            return [known, asked.success or {}, asked.failure or {}][: len(spec.children)]
        if spec.kind in (Kind.SEQUENCE, Kind.FALLBACK):
            members = [range(position) for position in range(len(spec.children))]
            return [self._known_after(spec, known, before) for before in members]
        if spec.kind in (Kind.INVERTER, Kind.SUBTREE, Kind.FORCE_SUCCESS, Kind.FORCE_FAILURE):
            return [known]
        whole = summary(spec, self.declared)
        kept = {} if whole.undeclared else without(known, whole.writes)
        return [kept] * len(spec.children)

    def _known_after(self, spec: NodeSpec, known: Known, before: Collection[int]) -> Known:
        """What is known when these children of a Sequence have succeeded, of a Fallback failed."""
        for position in sorted(before):
            found = ends(spec.children[position], known, self.declared)
            passed = found.success if spec.kind is Kind.SEQUENCE else found.failure
            known = passed if passed is not None else {}
        return known

    def _arranged(
        self, spec: NodeSpec, path: str, known: Known, guarding: frozenset[str]
    ) -> tuple[Arrangement, list[Known]]:
        """The least constrained arrangement of the children, and what is known before each."""
        count = len(spec.children)
        found = [summary(child, self.declared) for child in spec.children]
        assumed = path in self.independent
        trusted = [assumed and bool(one.undeclared) for one in found]
        if assumed:
            found = [replace(one, undeclared=()) for one in found]
        reasons = {
            (i, j): reason
            for j in range(count)
            for i in range(j)
            if (reason := self._conflict(spec, (i, j), found, guarding, assumed))
        }
        if spec.kind is Kind.SEQUENCE:
            self._order_by_failures(spec, known, found, trusted, reasons)
        work = [self._critical_us(child) for child in spec.children]
        arrangement, added = arrange(count, reasons, work)
        names = [label(child) for child in spec.children]
        dependences = [Dependence(names[i], names[j], reasons[i, j]) for i, j in sorted(reasons)]
        dependences += [
            Dependence(names[i], names[j], "only to keep the others: no nesting does", True)
            for i, j in added
        ]
        notes = ("its children are independent, as declared",) if assumed else ()
        self._decide(spec, path, arrangement, dependences, notes)
        before = _before(count, [*reasons, *added])
        return arrangement, [self._known_after(spec, known, before[j]) for j in range(count)]

    def _conflict(
        self,
        spec: NodeSpec,
        pair: Pair,
        found: list[EffectSummary],
        guarding: frozenset[str],
        assumed: bool,
    ) -> str | None:
        """Why the first of the pair has to come before the second, whatever may fail.

        `assumed`: the user has declared the children to be independent.
        """
        i, j = pair
        one, other = found[i], found[j]
        for summed in (one, other):
            if summed.undeclared:
                return f"{', '.join(summed.undeclared[:3])} declares nothing"
        same = assumed and _same_effects(spec, pair, self.declared)
        if spec.kind is Kind.FALLBACK and (one.writes or other.writes) and not same:
            name = label(spec.children[i if one.writes else j])
            return f"{name} acts on the world, and only one of them is to be done"
        touched = (one.writes & (other.reads | other.writes)) | (other.writes & one.reads)
        if touched and not same:
            return f"both touch {_listed(touched)}"
        if one.uses & other.uses:
            return f"both use {_listed(one.uses & other.uses)}"
        for index in pair:
            shared = found[index].writes & guarding
            if shared:
                name = label(spec.children[index])
                return f"{name} changes {_listed(shared)}, which a node above asks at every tick"
        if spec.kind is Kind.FALLBACK and spec.memory is Memory.NONE:
            # Behind the first child of a Fallback a condition is no guard, in a Parallel it is.
            for index in pair:
                if spec.children[index].contains(Kind.CONDITION):
                    name = label(spec.children[index])
                    return f"{name} is asked at every tick, and only if those before it fail"
        return None

    def _order_by_failures(
        self,
        spec: NodeSpec,
        known: Known,
        found: list[EffectSummary],
        trusted: list[bool],
        reasons: dict[Pair, str],
    ) -> None:
        """Add to `reasons` what follows from failures: where one child fails, the single robot has
        done all before it and nothing behind it.
        """
        count = len(spec.children)
        for j in range(count):
            self._support(spec, j, known, reasons, trusted)
        failing = [
            not trusted[index]
            and ends(child, self._known_after(spec, known, before), self.declared).may_fail
            for index, (child, before) in enumerate(
                zip(spec.children, _before(count, reasons), strict=True)
            )
        ]
        for j in range(count):
            for i in range(j):
                for index, beside in ((i, found[j]), (j, found[i])):
                    if failing[index] and beside.writes:
                        name = label(spec.children[index])
                        reason = f"{name} may fail, which the other one's work depends on"
                        reasons.setdefault((i, j), reason)

    def _support(
        self, spec: NodeSpec, j: int, known: Known, reasons: dict[Pair, str], trusted: list[bool]
    ) -> None:
        """Let child j wait for earlier ones whose success makes sure that it cannot fail."""
        child = spec.children[j]

        def may_fail(before: Collection[int]) -> bool:
            return ends(child, self._known_after(spec, known, before), self.declared).may_fail

        needed = set(_before(len(spec.children), reasons)[j])
        if trusted[j] or not may_fail(needed) or may_fail(range(j)):
            return
        for i in reversed(range(j)):
            if may_fail(needed) and may_fail(set(range(i)) | needed):
                needed |= {i} | _before(len(spec.children), reasons)[i]
                reason = f"its success makes sure that {label(child)} cannot fail"
                reasons.setdefault((i, j), reason)

    def _decide(
        self,
        spec: NodeSpec,
        path: str,
        arrangement: Arrangement | None,
        dependences: Collection[Dependence],
        notes: tuple[str, ...],
    ) -> None:
        names = tuple(label(child) for child in spec.children)
        after = " ; ".join(names) if arrangement is None else drawn(arrangement, names)
        self.decisions.append(
            LiftDecision(path, str(spec.kind), names, after, tuple(dependences), notes)
        )


def _flat(spec: NodeSpec, path: str, independent: Collection[str]) -> NodeSpec:
    """A Sequence of Sequences as one, a Fallback of Fallbacks; SubTrees are no boundary."""
    if spec.kind not in (Kind.SEQUENCE, Kind.FALLBACK):
        return spec
    children: list[NodeSpec] = []
    for position, child in enumerate(spec.children):
        here, inner = child_path(path, spec, position), child
        while inner.kind is Kind.SUBTREE:
            here, inner = child_path(here, inner, 0), inner.children[0]
        if (inner.kind, inner.memory) == (spec.kind, spec.memory) and here not in independent:
            children += _flat(inner, here, independent).children
        else:
            children.append(child)
    return replace(spec, children=tuple(children))


def _before(count: int, pairs: Collection[Pair]) -> list[set[int]]:
    """For each element all that come before it."""
    after = closure(count, pairs)
    return [{i for i in range(j) if j in after[i]} for j in range(count)]


def _may_stop(spec: NodeSpec, position: int, outcomes: list[Ends]) -> bool:
    """Whether the node can stop this child halfway, depending on how fast others are."""
    if spec.kind is not Kind.PARALLEL:
        return spec.kind is Kind.TIMEOUT
    others = outcomes[:position] + outcomes[position + 1 :]
    return spec.limit < len(spec.children) or any(other.may_fail for other in others)


def _same_effects(spec: NodeSpec, pair: Pair, declared: Declarations) -> bool:
    """Whether two alternatives of a Fallback are actions that change just the same."""
    if spec.kind is not Kind.FALLBACK:
        return False
    one, other = (spec.children[index] for index in pair)
    if one.kind is not Kind.ACTION or other.kind is not Kind.ACTION:
        return False
    nothing = Declaration()
    first, second = declared.get(one.subject, nothing), declared.get(other.subject, nothing)
    if first.writes or second.writes or first.effects != second.effects:
        return False
    touched = first.effects.keys()
    return not touched & (first.all_reads | second.all_reads)


def _is_as_before(arrangement: Arrangement, count: int) -> bool:
    return not isinstance(arrangement, Parallel | int) and arrangement.parts == tuple(range(count))


def _built(
    arrangement: Arrangement, spec: NodeSpec, children: tuple[NodeSpec, ...], is_top: bool
) -> NodeSpec:
    if isinstance(arrangement, int):
        return children[arrangement]
    parts = tuple(_built(part, spec, children, False) for part in arrangement.parts)
    name = spec.name if is_top else ""
    if not isinstance(arrangement, Parallel):
        return NodeSpec(spec.kind, parts, name, memory=spec.memory)
    needed = len(parts) if spec.kind is Kind.SEQUENCE else 1
    memory = Memory.NONE if spec.memory is Memory.NONE else Memory.WHILE_RUNNING
    return NodeSpec(Kind.PARALLEL, parts, name, limit=needed, memory=memory)


def drawn(arrangement: Arrangement, names: tuple[str, ...]) -> str:
    """A text such as `a ; (b | c) ; d`."""
    if isinstance(arrangement, int):
        return names[arrangement]
    parts = [drawn(part, names) for part in arrangement.parts]
    if isinstance(arrangement, Parallel):
        return " | ".join(
            f"({text})" if not isinstance(part, int) else text
            for part, text in zip(arrangement.parts, parts, strict=True)
        )
    return " ; ".join(
        f"({text})" if isinstance(part, Parallel) else text
        for part, text in zip(arrangement.parts, parts, strict=True)
    )


def _listed(names: Collection[str]) -> str:
    return ", ".join(sorted(names))


def working_time_us(spec: NodeSpec, work: Mapping[str, int], is_serial: bool) -> int:
    """How long the actions below take, one after the other (`is_serial`) or side by side.

    If nothing fails: of a Fallback the first that acts, of a Parallel the M soonest done.
    """
    if spec.kind is Kind.ACTION:
        return work.get(spec.subject, 1_000_000)
    parts = [working_time_us(child, work, is_serial) for child in spec.children]
    match spec.kind:
        case Kind.FALLBACK:
            children = zip(parts, spec.children, strict=True)
            return next((part for part, child in children if child.contains(Kind.ACTION)), 0)
        case Kind.PARALLEL:
            needed = sorted(parts)[: spec.limit]
            return sum(needed) if is_serial else max(needed)
        case Kind.IF_THEN_ELSE:
            return parts[0] + max(parts[1:])
        case Kind.REPEAT:
            return sum(parts) * max(1, spec.limit)
    return sum(parts)
