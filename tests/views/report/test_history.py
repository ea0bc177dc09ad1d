"""Which plan whom and when: against a plain reading of the same reports."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.views.report.history import PlansHeld

A, B = b"\xaa" * 16, b"\xbb" * 16
LOOKS = st.lists(
    st.dictionaries(st.sampled_from("XYZ"), st.sampled_from([b"", b"p", b"q", b"r"])), max_size=12
)


def held(*looks: dict[str, bytes], start_us: int = 0) -> PlansHeld:
    """One look at every second."""
    found = PlansHeld()
    for number, digests in enumerate(looks):
        found.look(digests, start_us + number * 1_000_000)
    found.look({}, start_us + len(looks) * 1_000_000)
    return found


def test_robots_take_a_plan_one_after_another() -> None:
    looks = [{"X": A, "Y": A}, {"X": A, "Y": B}, {"X": B, "Y": B}]
    first, second = held(*looks, start_us=5).plans(5)
    assert (first.number, first.digest, second.digest) == (1, "aaaaaaaa", "bbbbbbbb")
    assert (first.from_s, first.agreed_s, first.to_s) == (0, 0, 2)
    assert (second.from_s, second.agreed_s, second.to_s) == (1, 2, 3)
    assert second.since_s == {"Y": 1, "X": 2}


def test_a_plan_that_was_overtaken_was_never_agreed_on() -> None:
    plans = held({"X": A, "Y": A}, {"X": B, "Y": A}, {"X": A, "Y": A}).plans(0)
    assert [plan.agreed_s for plan in plans] == [0, None]
    assert plans[0].to_s == 3, "it was never given up"


def test_a_team_may_return_to_an_earlier_plan() -> None:
    assert [plan.from_s for plan in held({"X": A}, {"X": B}, {"X": A}).plans(0)] == [0, 1, 2]


def test_who_has_no_plan_agrees_with_nobody() -> None:
    (plan,) = held({"X": A, "Y": b""}, {"X": A}).plans(0)
    assert plan.agreed_s == 1, "Y is gone"
    assert plan.since_s == {"X": 0}


@given(LOOKS)
def test_every_report_is_in_one_plan(looks: list[dict[str, bytes]]) -> None:
    plans = held(*looks).plans(0)
    assert [plan.from_s for plan in plans] == sorted(plan.from_s for plan in plans)
    for at_s, digests in enumerate(looks):
        for robot, digest in digests.items():
            if digest:
                (plan,) = [
                    plan
                    for plan in plans
                    if plan.from_s <= at_s < plan.to_s and plan.digest == digest[:4].hex()
                ]
                assert plan.since_s[robot] <= at_s
                is_agreed = plan.agreed_s is not None and plan.agreed_s <= at_s
                assert is_agreed or len(set(digests.values())) > 1
