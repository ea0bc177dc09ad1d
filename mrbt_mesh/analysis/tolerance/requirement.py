"""What a tree requires: the sets of services without which its root can be kept from success.

A mission is *ruined* by faults if there are values of its conditions with which the tree could
succeed if every service were feasible, and cannot as things are. Conditions may read either value,
each time they are read (robots and the world change them); an action whose service is feasible
ends as the mission needs it; one whose service is not is blocked, which for ever keeps its parent
waiting, or fails where the global task says `blocked: {fail_after_s}`.

Per node there are four truths: whether it can succeed and whether it can fail, with every
service feasible (the ideal) and as things are. Which combinations the conditions allow is worked
out from the leaves up, each with the formula over infeasible services that makes it possible.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

from mrbt_mesh.core.bt.tree import Kind, Node, Tree
from mrbt_mesh.errors import InputError

# Formulas are numbered; equal formulas have the same number.
Formula: TypeAlias = int
NEVER: Formula = 0
ALWAYS: Formula = 1
MAX_FORMULAS = 2_000_000


class TooLargeError(InputError):
    """A tree has too many combinations to be analysed."""


@dataclass(frozen=True, slots=True)
class Term:
    """An atom (`service` is infeasible), or all or any of other formulas."""

    is_all: bool = False
    parts: tuple[Formula, ...] = ()
    service: int = -1


@dataclass
class Formulas:
    """Monotone formulas over infeasible services, smallest first; 0 and 1 are the constants."""

    terms: list[Term] = field(default_factory=lambda: [Term(), Term(True)])
    _known: dict[Term, Formula] = field(default_factory=dict)

    def atom(self, service: int) -> Formula:
        """Service number `service` is infeasible."""
        return self._number(Term(service=service))

    def any(self, parts: Iterable[Formula]) -> Formula:
        """At least one of `parts` holds."""
        return self._combined(False, parts)

    def all(self, parts: Iterable[Formula]) -> Formula:
        """Every one of `parts` holds."""
        return self._combined(True, parts)

    def _combined(self, is_all: bool, parts: Iterable[Formula]) -> Formula:
        neutral, decisive = (ALWAYS, NEVER) if is_all else (NEVER, ALWAYS)
        found: set[Formula] = set()
        for part in parts:
            if part == decisive:
                return decisive
            if part != neutral:
                term = self.terms[part]
                nested = term.service < 0 and term.is_all == is_all
                found.update(term.parts if nested else (part,))
        absorbed = {
            part
            for part in found
            if (term := self.terms[part]).service < 0 and not found.isdisjoint(term.parts)
        }
        left = sorted(found - absorbed)
        if not left:
            return neutral
        return left[0] if len(left) == 1 else self._number(Term(is_all, tuple(left)))

    def _number(self, term: Term) -> Formula:
        if term not in self._known:
            if len(self.terms) >= MAX_FORMULAS:
                raise TooLargeError("the tree is too large to be analysed: too many combinations")
            self._known[term] = len(self.terms)
            self.terms.append(term)
        return self._known[term]

    def below(self, formula: Formula) -> list[Formula]:
        """Return `formula` and all its parts, smallest first."""
        found = {formula}
        queue = [formula]
        for each in queue:
            for part in self.terms[each].parts:
                if part not in found:
                    found.add(part)
                    queue.append(part)
        return sorted(found)


@dataclass(frozen=True)
class Requirement:
    """When infeasible services ruin a mission; `ruin` is a formula of `formulas`."""

    formulas: Formulas
    ruin: Formula

    def is_ruined(self, infeasible: Collection[int]) -> bool:
        """Return whether the mission is ruined if these services are infeasible."""
        holds: dict[Formula, bool] = {NEVER: False, ALWAYS: True}
        for each in self.formulas.below(self.ruin):
            if each in holds:
                continue
            term = self.formulas.terms[each]
            if term.service >= 0:
                holds[each] = term.service in infeasible
            else:
                values = (holds[part] for part in term.parts)
                holds[each] = all(values) if term.is_all else any(values)
        return holds[self.ruin]

    @property
    def services(self) -> list[int]:
        """The services that can make a difference."""
        terms = (self.formulas.terms[each] for each in self.formulas.below(self.ruin))
        return sorted({term.service for term in terms if term.service >= 0})

    @property
    def indispensable(self) -> list[int]:
        """The services that ruin the mission alone."""
        return [each for each in self.services if self.is_ruined({each})]

    def simplified(self) -> Requirement:
        """Return the same, simplified to *any of the indispensable services* where that is
        equivalent.
        """
        needed = self.indispensable
        if not self.is_ruined(set(self.services) - set(needed)):
            return every(needed)
        return self


def every(services: Collection[int]) -> Requirement:
    """Return the requirement that needs all of these services."""
    formulas = Formulas()
    return Requirement(formulas, formulas.any(formulas.atom(each) for each in services))


# Can succeed, can fail: with every service feasible (ideal), and as things are.
State: TypeAlias = tuple[bool, bool, bool, bool]
States: TypeAlias = dict[State, Formula]
# Global task -> the service without which it cannot even fail. Tasks not listed can always fail.
Deciding: TypeAlias = Mapping[str, int]
_Merge: TypeAlias = Callable[[tuple[int, ...], State], tuple[int, ...]]


def tree_requirement(
    tree: Tree,
    services: Mapping[str, Sequence[int]],
    waits: Callable[[str], bool],
    deciding: Deciding = MappingProxyType({}),
) -> Requirement | None:
    """Return what `tree` requires.

    None if its root cannot succeed even if every service is feasible. `services`: global task ->
    the numbers of the services that it needs. `waits`: whether a task is blocked forever rather
    than failing. Raises TooLargeError.
    """
    states = _Builder(tree, services, waits, deciding)
    found = states.of(tree.nodes[0])
    if not any(state[0] for state in found):
        return None
    bad = (formula for state, formula in found.items() if state[0] and not state[2])
    return Requirement(states.formulas, states.formulas.any(bad)).simplified()


class _Builder:
    def __init__(
        self,
        tree: Tree,
        services: Mapping[str, Sequence[int]],
        waits: Callable[[str], bool],
        deciding: Deciding,
    ) -> None:
        self.tree = tree
        self.deciding = deciding
        self.services = services
        self.waits = waits
        self.formulas = Formulas()
        self._acts = tree.containing(Kind.ACTION)

    def of(self, node: Node) -> States:
        """Return the combinations that the conditions below `node` allow, with their formulas."""
        if node.kind is Kind.CONDITION:
            return {(True, False, True, False): ALWAYS, (False, True, False, True): ALWAYS}
        if node.kind is Kind.ACTION:
            lacking = self.formulas.any(map(self.formulas.atom, self.services[node.subject]))
            fails = not self.waits(node.subject)
            found = {(True, True, True, True): ALWAYS, (True, True, False, fails): lacking}
            if node.subject in self.deciding:
                # If it must fail, whether it could succeed makes no difference.
                none_left = self.formulas.atom(self.deciding[node.subject])
                found[True, True, not fails, False] = none_left
            return found
        children = [self.of(self.tree.nodes[child]) for child in node.children]
        if node.kind is Kind.SEQUENCE:
            return self._folded(children, (1, 0, 1, 0), _in_sequence, _bools)
        if node.kind is Kind.FALLBACK:
            return self._folded(children, (0, 1, 0, 1), _in_fallback, _bools)
        if node.kind is Kind.PARALLEL:
            return self._parallel(children, node.limit, node.failures)
        if node.kind is Kind.IF_THEN_ELSE:
            if len(children) == 2:
                children.append({(False, True, False, True): ALWAYS})
            return self._folded(children, (), _in_branches, _bools)
        return self._mapped(children[0], self._decorator(node))

    def _mapped(self, states: States, change: Callable[[bool, bool], tuple[bool, bool]]) -> States:
        found: dict[State, list[Formula]] = {}
        for (ideal_s, ideal_f, s, f), formula in states.items():
            state = (*change(ideal_s, ideal_f), *change(s, f))
            found.setdefault(state, []).append(formula)
        return {state: self.formulas.any(parts) for state, parts in found.items()}

    def _decorator(self, node: Node) -> Callable[[bool, bool], tuple[bool, bool]]:
        """Return the map from (can succeed, can fail) of the child to those of the node."""
        endless = node.limit < 0
        acts = self._acts[node.index]
        match node.kind:
            case Kind.INVERTER:
                return lambda s, f: (f, s)
            case Kind.FORCE_SUCCESS:
                return lambda s, f: (s or f, False)
            case Kind.FORCE_FAILURE:
                return lambda s, f: (False, s or f)
            case Kind.RETRY:
                return lambda s, f: (s, f and not endless)
            case Kind.REPEAT:
                return lambda s, f: (s and not endless, f)
            case Kind.KEEP_RUNNING_UNTIL_FAILURE:
                return lambda _s, f: (False, f)
            case Kind.TIMEOUT:  # actions may take too long, blocked or not
                return lambda s, f: (s, f or acts)
        return lambda s, f: (s, f)

    def _folded(
        self,
        children: Sequence[States],
        start: tuple[int, ...],
        merge: _Merge,
        result: Callable[[tuple[int, ...]], State],
    ) -> States:
        """Merge the children one after another."""
        before: dict[tuple[int, ...], Formula] = {start: ALWAYS}
        for child in children:
            after: dict[tuple[int, ...], list[Formula]] = {}
            for state, formula in before.items():
                for own, possible in child.items():
                    both = self.formulas.all((formula, possible))
                    after.setdefault(merge(state, own), []).append(both)
            before = {state: self.formulas.any(parts) for state, parts in after.items()}
        found: dict[State, list[Formula]] = {}
        for state, formula in before.items():
            found.setdefault(result(state), []).append(formula)
        return {state: self.formulas.any(parts) for state, parts in found.items()}

    def _parallel(self, children: Sequence[States], needed: int, failures: int) -> States:
        """Count children that can succeed and that can fail, as far as the counts matter."""
        enough = (needed, failures or len(children) - needed + 1) * 2

        def merge(counts: tuple[int, ...], own: State) -> tuple[int, ...]:
            pairs = zip(counts, own, enough, strict=True)
            return tuple(min(count + can, most) for count, can, most in pairs)

        def result(counts: tuple[int, ...]) -> State:
            s, f, actual_s, actual_f = (c == m for c, m in zip(counts, enough, strict=True))
            return s, f, actual_s, actual_f

        return self._folded(children, (0, 0, 0, 0), merge, result)


def _by_halves(merge: Callable[[bool, bool, bool, bool], tuple[bool, bool]]) -> _Merge:
    """Merge (succeeds, fails) so far with those of a child, in the ideal and in the actual case."""

    def both(before: tuple[int, ...], own: State) -> tuple[int, ...]:
        s, f, actual_s, actual_f = map(bool, before)
        return (*merge(s, f, *own[:2]), *merge(actual_s, actual_f, *own[2:]))

    return both


_in_sequence = _by_halves(lambda s, f, own_s, own_f: (s and own_s, f or (s and own_f)))
_in_fallback = _by_halves(lambda s, f, own_s, own_f: (s or (f and own_s), f and own_f))


def _bools(state: tuple[int, ...]) -> State:
    s, f, actual_s, actual_f = map(bool, state)
    return s, f, actual_s, actual_f


def _in_branches(before: tuple[int, ...], own: State) -> tuple[int, ...]:
    """Merge condition, then-branch and else-branch, in this order."""
    if not before:
        return own
    s, f, actual_s, actual_f, *chosen = before
    if not chosen:
        then = (s & own[0], s & own[1], actual_s & own[2], actual_s & own[3])
        return (*before, *then)
    otherwise = (f & own[0], f & own[1], actual_f & own[2], actual_f & own[3])
    return tuple(one | other for one, other in zip(chosen, otherwise, strict=True))
