"""The paper's situations I to VIII, found in the record of a run by what holds in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from paper.account import Account, AccountError
from paper.scene import Cover, Part, Scene, Screws, moments, scene

BOTH_A, BOTH_B, BOTH_C = {"A1", "A2"}, {"B1", "B2"}, {"C1", "C2"}


@dataclass(frozen=True)
class Situation:
    """One of the eight: `holds` is the condition for it, `text` describes it."""

    number: str
    title: str
    text: str
    holds: Callable[[Scene], bool]


def _team_is_ready(now: Scene) -> bool:
    return (
        now.joined == set(now.team)
        and not now.work
        and now.cover is Cover.ON
        and set(now.parts.values()) == {Part.UNKNOWN}
    )


def _screws_are_taken_out(now: Scene) -> bool:
    return (
        set(now.work) == set(now.at_work("use_screwdriver")) == BOTH_C
        and now.screws is Screws.GOING_OUT
    )


def _four_diagnose_and_the_fifth_waits(now: Scene) -> bool:
    diagnosed = now.at_work("do_diagnosis")
    left = set(now.parts) - set(diagnosed.values())
    return (
        now.cover is Cover.OFF
        and set(diagnosed) == BOTH_A | BOTH_B
        and len(left) == 1
        and set(now.parts.values()) == {Part.UNKNOWN}
    )


def _the_fast_ones_go_on(now: Scene) -> bool:
    diagnosed = now.at_work("do_diagnosis")
    known = [part for part, state in now.parts.items() if state is not Part.UNKNOWN]
    return (
        len(diagnosed.keys() & BOTH_B) == 2
        and len(diagnosed.keys() & BOTH_A) == 1
        and len(known) == 2
        and set(now.parts) == {*known, *diagnosed.values()}
    )


def _hardware_is_replaced(now: Scene) -> bool:
    at_hardware = now.at_work("replace_hw")
    return (
        Part.UNKNOWN not in now.parts.values()
        and set(now.work) == set(at_hardware) == BOTH_A
        and sorted(at_hardware.values()) == _broken(now)
    )


def _a_dead_robot_is_replaced(now: Scene) -> bool:
    at_wires = now.at_work("replace_wires")
    for robot, fault in now.dead.items():
        if robot not in BOTH_A or fault.held is None or fault.reassigned_us is None:
            continue
        (other,) = BOTH_A - {robot}
        taken_over = {r for r, part in at_wires.items() if part == now.last[robot]}
        return (
            fault.reassigned_us <= now.at_us
            and fault.replacement in taken_over
            and taken_over == BOTH_B
            and other in at_wires
            and sorted(set(at_wires.values())) == _broken(now)
        )
    return False


def _wires_are_soldered(now: Scene) -> bool:
    soldered = now.at_work("use_soldering_iron")
    return set(now.work) == set(soldered) == BOTH_B and sorted(set(soldered.values())) == _broken(
        now
    )


def _the_cover_is_put_back(now: Scene) -> bool:
    return (
        now.cover is Cover.GOING_ON
        and set(now.work) == BOTH_C
        and set(now.parts.values()) == {Part.IN_ORDER, Part.REPAIRED}
    )


def _broken(now: Scene) -> list[str]:
    return sorted(part for part, state in now.parts.items() if state is Part.BROKEN)


SITUATIONS = (
    Situation(
        "I",
        "The team is ready",
        "The cover is on, nothing is known of the five parts, and all six robots have joined. "
        "While `nominal` holds, T_G asks for nothing and nobody is assigned; it is false here, "
        "so the first request is out, but nobody has started yet.",
        _team_is_ready,
    ),
    Situation(
        "II",
        "Both C take the screws out",
        "`remove_screws` wants at least 1 and at most 2 robots for `use_screwdriver`. Two can do "
        "it, so both are assigned; nobody else has a request to serve.",
        _screws_are_taken_out,
    ),
    Situation(
        "III",
        "Four diagnoses at once",
        "Five diagnoses want a robot each, and four robots can make one. The fifth request would "
        "make the problem infeasible, so it is left out and waits.",
        _four_diagnose_and_the_fifth_waits,
    ),
    Situation(
        "IV",
        "The fast ones go on",
        "A diagnoses three times as fast as B. Both A have finished while both B are in the "
        "middle of it: one takes the part that had to wait, the other is free.",
        _the_fast_ones_go_on,
    ),
    Situation(
        "V",
        "The best robots put in new hardware",
        "All is diagnosed. Two parts are broken, one robot is wanted for each, and A is better "
        "at hardware than B: both A work, both B rest.",
        _hardware_is_replaced,
    ),
    Situation(
        "VI",
        "A robot of type A has died",
        "It had put in its hardware and was to go on with the wires of the same part. Wires take "
        "at most 2 robots: both B do them in its place, while the other A does those of the "
        "other part.",
        _a_dead_robot_is_replaced,
    ),
    Situation(
        "VII",
        "Only B can solder",
        "The new wires are in. The A that lives has no soldering iron and rests.",
        _wires_are_soldered,
    ),
    Situation(
        "VIII",
        "The cover is put back",
        "All parts are in order. Both C lift at the same time; `place_screws` follows, and T_G "
        "returns success.",
        _the_cover_is_put_back,
    ),
)


def find(account: Account) -> list[Scene]:
    """The first moment of each situation, each after the one before.

    Raises AccountError for one that the run does not come to.
    """
    scenes = [scene(account, at_us) for at_us in moments(account)]
    found: list[Scene] = []
    for situation in SITUATIONS:
        after_us = found[-1].at_us if found else -1
        later = (s for s in scenes if s.at_us > after_us and situation.holds(s))
        now = next(later, None)
        if now is None:
            since = f"after {after_us / 1e6:.6f} s" if found else "at any time"
            raise AccountError(
                f"seed {account.seed}: situation {situation.number} "
                f"({situation.title}) is not in the record {since}"
            )
        found.append(now)
    return found
