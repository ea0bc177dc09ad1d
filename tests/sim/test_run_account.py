"""The paper's account of the run (section VI), judged by what the robots recorded themselves."""

from __future__ import annotations

import itertools

import pytest

from mrbt_mesh.drills.physical import Span, most_at_once, of
from tests.support.runs import undisturbed

SEEDS = range(5)


@pytest.fixture(params=SEEDS, ids="seed{}".format)
def account(request: pytest.FixtureRequest) -> list[Span]:
    return list(undisturbed(request.param))


@pytest.mark.slow
def test_the_cover_is_off_before_and_on_after_everything_else(account: list[Span]) -> None:
    order = [
        "remove_screws",
        "remove_cover",
        "diagnose_part",
        "fix_",
        "place_cover",
        "place_screws",
    ]
    groups = [[s for s in account if s.global_task.startswith(name)] for name in order]
    # `fix_` holds hardware and wires; soldering belongs between them and the cover.
    groups[3] += of(account, "use_soldering_iron")
    for before, after in itertools.pairwise(groups):
        assert before
        assert after
        assert max(s.end_s for s in before) < min(s.start_s for s in after)


@pytest.mark.slow
def test_both_c_are_on_the_screws_and_both_move_the_frame(account: list[Span]) -> None:
    for task in ("remove_screws", "remove_cover", "place_cover", "place_screws"):
        used = [s for s in account if s.global_task == task]
        assert {s.robot for s in used} == {"C1", "C2"}, task
        assert most_at_once(used) == 2, task


def test_four_diagnoses_at_once_and_the_fifth_by_the_first_robot_that_is_free(
    account: list[Span],
) -> None:
    diagnoses = of(account, "do_diagnosis")
    assert len(diagnoses) == 5
    assert most_at_once(diagnoses) == 4
    first_four, fifth = diagnoses[:4], diagnoses[4]
    assert {s.robot for s in first_four} == {"A1", "A2", "B1", "B2"}
    free = min(first_four, key=lambda span: span.end_s)
    assert free.end_s <= fifth.start_s < free.end_s + 0.05
    assert free.robot[0] == fifth.robot[0] == "A"


def test_a_robots_replace_hardware_while_both_b_rest(account: list[Span]) -> None:
    hardware = of(account, "replace_hw")
    assert {(s.part, s.robot[0]) for s in hardware} == {("2", "A"), ("4", "A")}
    assert len({s.robot for s in hardware}) == 2
    others = [s for s in account if s.robot[0] == "B"]
    assert not any(span.overlaps(other) for span in hardware for other in others)


def test_at_most_two_robots_of_type_a_or_b_per_set_of_wires(account: list[Span]) -> None:
    for part in ("2", "4"):
        wires = of(account, "replace_wires", part)
        assert 1 <= most_at_once(wires) <= 2
        assert {s.robot[0] for s in wires} <= {"A", "B"}
        assert max(s.end_s for s in of(account, "replace_hw", part)) < min(s.start_s for s in wires)


def test_only_b_solders_and_only_what_was_broken(account: list[Span]) -> None:
    soldering = of(account, "use_soldering_iron")
    assert {s.robot[0] for s in soldering} == {"B"}
    assert {s.part for s in soldering} == {"2", "4"}
    for local_task in ("replace_hw", "replace_wires"):
        assert {s.part for s in of(account, local_task)} == {"2", "4"}


def test_nobody_does_two_things_at_once(account: list[Span]) -> None:
    for robot in {s.robot for s in account}:
        assert most_at_once(s for s in account if s.robot == robot) == 1
