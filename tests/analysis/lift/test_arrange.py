"""Series-parallel arrangements keep an order, and where they can, nothing but that order."""

from __future__ import annotations

from itertools import permutations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.analysis.lift.arrange import Arrangement, Pair, Parallel, Series, arrange, closure


def order_of(arrangement: Arrangement) -> set[Pair]:
    """All pairs that the arrangement puts one after the other."""
    if isinstance(arrangement, int):
        return set()
    found = set().union(*map(order_of, arrangement.parts))
    if isinstance(arrangement, Series):
        groups = [elements(part) for part in arrangement.parts]
        for index, first in enumerate(groups):
            for second in groups[index + 1 :]:
                found |= {(i, j) for i in first for j in second}
    return found


def elements(arrangement: Arrangement) -> list[int]:
    if isinstance(arrangement, int):
        return [arrangement]
    return sorted(e for part in arrangement.parts for e in elements(part))


def has_an_n(count: int, order: set[Pair]) -> bool:
    """Whether four elements stand as the letter N: a < c, a < d, b < d and nothing else."""
    for a, b, c, d in permutations(range(count), 4):
        shape = {(a, c), (a, d), (b, d)}
        among = {pair for pair in order if set(pair) <= {a, b, c, d}}
        if among == shape:
            return True
    return False


@st.composite
def orders(draw: st.DrawFn) -> tuple[int, set[Pair]]:
    count = draw(st.integers(1, 7))
    pairs = [(i, j) for j in range(count) for i in range(j)]
    return count, set(draw(st.lists(st.sampled_from(pairs), max_size=10)) if pairs else [])


@given(orders(), st.data())
def test_an_arrangement_keeps_the_order_and_says_what_it_adds(
    case: tuple[int, set[Pair]], data: st.DataObject
) -> None:
    count, before = case
    work = data.draw(st.lists(st.integers(1, 9), min_size=count, max_size=count))
    arrangement, added = arrange(count, before, work)
    assert elements(arrangement) == list(range(count))
    whole = {(i, j) for i, later in enumerate(closure(count, before)) for j in later}
    assert order_of(arrangement) == whole | set(added)
    assert not whole & set(added)
    assert bool(added) == has_an_n(count, whole)


def test_nested_orders() -> None:
    assert arrange(3, [], [1] * 3) == (Parallel((0, 1, 2)), ())
    assert arrange(3, [(0, 1), (1, 2)], [1] * 3) == (Series((0, 1, 2)), ())
    two_chains = [(0, 2), (1, 3)]
    assert arrange(4, two_chains, [1] * 4) == (Parallel((Series((0, 2)), Series((1, 3)))), ())


def test_an_n_is_cut_where_it_costs_least() -> None:
    """0 before 2 and 3, 1 before 3. Behind a long 1 nothing else should wait."""
    letter = [(0, 2), (0, 3), (1, 3)]
    arrangement, added = arrange(4, letter, [1, 1, 1, 1])
    assert arrangement == Series((Parallel((0, 1)), Parallel((2, 3))))
    assert added == ((1, 2),)
