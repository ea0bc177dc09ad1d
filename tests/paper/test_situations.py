"""The situations of the paper in the run's record, and what their pictures show."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from mrbt_mesh.sim import Lose
from paper.account import Account, AccountError, load, run, tell
from paper.caption import caption
from paper.picture import SIDES, draw, place, positions
from paper.scene import Cover, Part, Scene, Screws, moments, scene
from paper.situations import SITUATIONS, find
from tests.support.effort import seeds

SEEDS = [1 + seed for seed in seeds(10)]
NUMBERS = ["I", "II", "III", "IV", "V", "VI", "VII", "VIII"]
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def account() -> Account:
    return tell()


@pytest.fixture(scope="module")
def scenes(account: Account) -> dict[str, Scene]:
    return dict(zip((s.number for s in SITUATIONS), find(account), strict=True))


def colours(svg: str) -> dict[str, str]:
    """Part -> its colour in the picture."""
    root = ElementTree.fromstring(svg)
    found = (shape for shape in root.iter(f"{SVG}rect") if "part " in shape.get("class", ""))
    return {shape.get("id", "").removeprefix("part"): shape.get("class", "")[5:] for shape in found}


@pytest.mark.parametrize("seed", SEEDS)
def test_every_run_comes_to_all_eight_in_order_and_succeeds(seed: int) -> None:
    account = tell(seed)
    found = [s.at_us for s in find(account)]
    assert [s.number for s in SITUATIONS] == NUMBERS
    assert found == sorted(set(found)), f"seed {seed}"
    assert account.result.result == "success", f"seed {seed}"
    assert [(f.robot, f.until_us) for f in account.record.major] == [("A2", None)], f"seed {seed}"


def test_without_the_fault_the_sixth_is_missing_and_the_message_says_so() -> None:
    calm = run(load(), 1)
    with pytest.raises(AccountError, match=r"seed 1: situation VI \(A robot of type A has died\)"):
        find(calm)


def test_who_works_where(scenes: dict[str, Scene]) -> None:
    told = {
        number: {(robot, span.ground) for robot, span in now.work.items()}
        for number, now in scenes.items()
    }
    assert told["I"] == set()
    assert told["II"] == {("C1", "use_screwdriver"), ("C2", "use_screwdriver")}
    assert {task for _, task in told["III"]} == {f"do_diagnosis({k})" for k in (1, 2, 3, 4)}
    assert {robot for robot, _ in told["III"]} == {"A1", "A2", "B1", "B2"}
    assert {robot for robot, _ in told["IV"]} >= {"B1", "B2"}
    assert "do_diagnosis(5)" in {task for robot, task in told["IV"] if robot[0] == "A"}
    assert told["V"] == {("A1", "replace_hw(2)"), ("A2", "replace_hw(4)")}
    assert told["VI"] == {
        ("A1", "replace_wires(2)"),
        ("B1", "replace_wires(4)"),
        ("B2", "replace_wires(4)"),
    }
    assert {task for _, task in told["VII"]} == {"use_soldering_iron(2)", "use_soldering_iron(4)"}
    assert {robot for robot, _ in told["VII"]} == {"B1", "B2"}
    assert told["VIII"] == {("C1", "move_frame"), ("C2", "move_frame")}
    assert scenes["VIII"].resting == ["A1", "B1", "B2"]


def test_parts_cover_and_screws(scenes: dict[str, Scene]) -> None:
    unknown = dict.fromkeys("12345", Part.UNKNOWN)
    diagnosed = dict.fromkeys("135", Part.IN_ORDER) | dict.fromkeys("24", Part.BROKEN)
    for number in ("I", "II", "III"):
        assert scenes[number].parts == unknown, number
    assert scenes["IV"].parts == unknown | {"1": Part.IN_ORDER, "2": Part.BROKEN}
    for number in ("V", "VI", "VII"):
        assert scenes[number].parts == diagnosed, number
    assert scenes["VIII"].parts == diagnosed | dict.fromkeys("24", Part.REPAIRED)
    covers = [now.cover for now in scenes.values()]
    assert covers == [Cover.ON] * 2 + [Cover.OFF] * 5 + [Cover.GOING_ON]
    screws = [now.screws for now in scenes.values()]
    assert screws == [Screws.IN, Screws.GOING_OUT] + [Screws.OUT] * 6


def test_at_the_end_all_is_as_it_was_but_repaired(account: Account) -> None:
    last = scene(account, moments(account)[-1])
    assert (last.cover, last.screws, last.work) == (Cover.ON, Screws.IN, {})
    assert [last.parts[part] for part in "24"] == [Part.REPAIRED] * 2


@pytest.mark.parametrize("number", NUMBERS)
def test_the_picture_shows_the_scene(number: str, scenes: dict[str, Scene]) -> None:
    now = scenes[number]
    svg = draw(now, number, ["first line", "a < b & c"])
    colour_of = {
        Part.UNKNOWN: "unknown",
        Part.BROKEN: "broken",
        Part.IN_ORDER: "good",
        Part.REPAIRED: "good",
    }
    assert colours(svg) == {part: colour_of[state] for part, state in now.parts.items()}
    root = ElementTree.fromstring(svg)
    robots = {g.get("id"): g for g in root.iter(f"{SVG}g") if g.get("class") == "robot"}
    assert set(robots) == set(now.team)
    for robot, drawn in robots.items():
        shape = {"A": "circle", "B": "polygon", "C": "rect"}[now.team[str(robot)]]
        assert drawn.find(f"{SVG}{shape}") is not None, robot
        crossed = any(p.get("class") == "crossed" for p in drawn.iter(f"{SVG}path"))
        assert crossed == (robot in now.dead), robot
    assert sum("arm" in line.get("class", "") for line in root.iter(f"{SVG}line")) == len(now.work)
    assert "a < b & c" in [text.text for text in root.iter(f"{SVG}text")]
    assert not re.search(r"href|url\(|<script|@import", svg), "the picture needs nothing else"
    assert "prefers-color-scheme: dark" in svg


@pytest.mark.parametrize("number", NUMBERS)
def test_robots_stand_where_they_work_and_not_on_one_another(
    number: str, scenes: dict[str, Scene]
) -> None:
    now = scenes[number]
    where = positions(now)
    assert set(where) == set(now.team)
    for robot, span in now.work.items():
        if span.part:
            centre, row = place(now, span.part)
            x, y = where[robot]
            assert abs(x - centre) <= 40, robot
            assert y == (SIDES[0] if row < sum(SIDES) / 2 else SIDES[1]), robot
    for robot in now.resting:
        assert where[robot][1] > SIDES[1], f"{robot} rests away from the vehicle"
    for robot, (x, y) in where.items():
        near = [o for o, (u, v) in where.items() if abs(x - u) + abs(y - v) < 40 and o != robot]
        assert near == [], robot


def test_the_dead_robot_stays_beside_the_part_that_it_held(scenes: dict[str, Scene]) -> None:
    for number in ("VI", "VII", "VIII"):
        now = scenes[number]
        assert now.last["A2"] == "4"
        assert abs(positions(now)["A2"][0] - place(now, "4")[0]) <= 60
        assert "A2" not in now.resting


def test_the_caption_tells_of_both_kinds_of_faults() -> None:
    account = run(load(), 3, (6_000_000, Lose("B1", "replace_wires")))
    assert account.record.minor, "seed 3"
    before, after = scene(account, 5_900_000), scene(account, 6_900_000)
    assert caption(before, account.record)[2] == "Faults: none."
    assert "B1 has lost replace_wires since 5.9" in caption(after, account.record)[2]
    told = tell()
    sixth = caption(find(told)[5], told.record)
    assert sixth[0].endswith("A1 replace_wires(2); B1 and B2 replace_wires(4); at rest C1 and C2.")
    assert sixth[1] == "Parts: 1, 3 and 5 in order; 2 and 4 broken."
    assert re.fullmatch(
        r"Faults: A2 dead since 13\.\d\d s, it held replace_wires\(4\), "
        r"which B[12] started within \d+ ms\.",
        sixth[2],
    )
