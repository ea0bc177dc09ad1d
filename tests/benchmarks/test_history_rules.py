"""Each rule finds what breaks it, and honest histories break none."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.history_rules import (
    CANCEL,
    DONE,
    HOLD,
    LONG_AGO,
    PRIORITY,
    REFUSED,
    RELEASE,
    RULES,
    SUBMIT,
    UNKNOWN,
    Fault,
    History,
    Operation,
    Read,
    Work,
    violations,
)


def op(
    kind: str, at_s: float, answer: str = DONE, *, job: str = "j", value: int = 1, text: str = ""
) -> Operation:
    return Operation("c", kind, job, value, at_s, at_s + 0.1, answer, text)


def read(state: str, priority: int = 0) -> Read:
    return Read("c", "j", state, priority, 100, 100.1)


def work(robot: str, at_s: float, end: str = "success", content: int = 1) -> Work:
    return Work(robot, content, at_s, at_s + 0.3, end)


SUBMITTED = op(SUBMIT, 1)
CUT = Fault("cut", "R1", 4, 30)


def history(
    *operations: Operation,
    works: tuple[Work, ...] = (),
    final: str = "succeeded",
    priority: int = 0,
    faults: tuple[Fault, ...] = (),
) -> History:
    return History(
        operations=[SUBMITTED, *operations],
        works=list(works),
        faults=list(faults),
        exclusive={1},
        final={"j": [read(final, priority)]},
    )


HONEST = {
    "done": history(works=(work("R1", 2),)),
    "done, and long ago": history(works=(work("R1", 2),), final=LONG_AGO),
    "in doubt, and long ago": history(final=LONG_AGO, faults=(CUT,)),
    "in doubt": history(works=(work("R1", 2, ""),), final="failed"),
    "cancelled": history(op(CANCEL, 2), final="cancelled"),
    "cancelled by a request without an answer": history(op(CANCEL, 2, UNKNOWN), final="cancelled"),
    "cancelled, done by one that was cut off": history(
        op(CANCEL, 5), works=(work("R1", 20),), final="succeeded", faults=(CUT,)
    ),
    "held at the end": history(op(HOLD, 2), final="held"),
    "held and released": history(op(HOLD, 2), op(RELEASE, 5), works=(work("R1", 6),)),
    "held and released at once": history(op(HOLD, 2), op(RELEASE, 2.05), works=(work("R1", 6),)),
    "not due": replace(history(final="waiting"), parked={"j"}),
    "the same again": history(op(SUBMIT, 3), works=(work("R1", 2),)),
    "another content is refused": history(op(SUBMIT, 3, REFUSED, value=2), works=(work("R1", 2),)),
    "two priorities at once": history(
        op(HOLD, 1.5),
        op(PRIORITY, 2, value=5),
        op(PRIORITY, 2.05, value=7),
        final="held",
        priority=5,
    ),
    "a priority without an answer may come late": history(
        op(HOLD, 1.5),
        op(PRIORITY, 2, UNKNOWN, value=5),
        op(PRIORITY, 9, value=7),
        final="held",
        priority=5,
    ),
}
BROKEN = {
    "answered": [
        replace(HONEST["done"], operations=[replace(SUBMITTED, answered_s=None)]),
        replace(HONEST["done"], operations=[replace(SUBMITTED, answered_s=60.0)]),
        history(op(CANCEL, 3, UNKNOWN, text="!HTTP 500"), works=(work("R1", 2),)),
    ],
    "one content": [history(op(SUBMIT, 3, value=2), works=(work("R1", 2),))],
    "lost": [
        history(final=""),
        history(final="waiting"),
        history(final="held"),
        history(final="succeeded"),
        history(final="cancelled"),
        history(final=LONG_AGO),
        history(final=LONG_AGO, faults=(Fault("kill", "R1", 0.1, 0.2),)),
        replace(history(final=LONG_AGO, faults=(CUT,)), exclusive=set()),
        history(op(CANCEL, 2, REFUSED), final="cancelled"),
        replace(HONEST["done"], final={"j": [read("succeeded"), read("failed")]}),
    ],
    "twice": [
        history(works=(work("R1", 2), work("R2", 5))),
        history(works=(work("R1", 2, ""), work("R2", 5))),
        history(works=(work("R1", 2), work("R2", 2.1))),
    ],
    "not asked for": [
        history(works=(work("R1", 2), work("R1", 5, content=9))),
        history(op(SUBMIT, 3, REFUSED, value=2), works=(work("R1", 2), work("R1", 5, content=2))),
    ],
    "cancelled": [
        history(op(CANCEL, 3), works=(work("R1", 5),)),
        history(op(CANCEL, 3), works=(work("R2", 5),), faults=(CUT,)),
        history(op(CANCEL, 3), final="waiting"),
    ],
    "held": [
        history(op(HOLD, 2), works=(work("R1", 6),)),
        history(op(HOLD, 2), op(RELEASE, 9), works=(work("R1", 6),)),
        history(op(RELEASE, 1.2), op(HOLD, 2), works=(work("R1", 6),)),
    ],
    "in force": [
        history(op(HOLD, 2), op(PRIORITY, 3, value=5), final="held", priority=0),
        history(
            op(HOLD, 1.5),
            op(PRIORITY, 2, value=5),
            op(PRIORITY, 9, value=7),
            final="held",
            priority=5,
        ),
        history(op(HOLD, 2), op(RELEASE, 5), final="held"),
        history(op(RELEASE, 2), op(HOLD, 5), final="waiting"),
    ],
}


@pytest.mark.parametrize("name", HONEST)
def test_an_honest_history_breaks_no_rule(name: str) -> None:
    assert not any(violations(HONEST[name]).values())


@pytest.mark.parametrize(
    ("rule", "broken"), [(rule, each) for rule, cases in BROKEN.items() for each in cases]
)
def test_what_breaks_a_rule_is_found(rule: str, broken: History) -> None:
    assert violations(broken)[rule]


def test_every_rule_has_a_history_that_breaks_it() -> None:
    assert tuple(BROKEN) == RULES
    assert tuple(violations(History())) == RULES


@pytest.mark.parametrize(("priority", "broken"), [(7, False), (3, True)])
def test_a_parked_job_is_judged_by_what_was_shown_before_it_was_cancelled(
    priority: int, broken: bool
) -> None:
    given = history(op(PRIORITY, 2, value=7), op(CANCEL, 400), final="cancelled")
    given.parked.add("j")
    given.quiet["j"] = [read("waiting", priority)]
    assert bool(violations(given)["in force"]) is broken
    assert not violations(given)["lost"]
