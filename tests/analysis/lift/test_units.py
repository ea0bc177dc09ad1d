"""What stays together and what is cut apart, case by case."""

from __future__ import annotations

import pytest

from mrbt_mesh.analysis.lift.units import Knowledge, OwnUse, Piece, split
from mrbt_mesh.btcpp.files.expand import ExpandedNode, expand
from tests.support.unit_trees import read

MODELS = """<TreeNodesModel>
<Action ID="Find"><output_port name="at"/></Action>
<Action ID="Go"><input_port name="to"/></Action>
<Action ID="Work"/><Action ID="Other"/>
<Condition ID="Ok"/>
</TreeNodesModel>"""
FIND, GO, WORK, OTHER = '<Find at="{p}"/>', '<Go to="{p}"/>', "<Work/>", "<Other/>"


def pieces(body: str, knowledge: Knowledge | None = None, trees: str = "") -> Piece:
    text = (
        '<root BTCPP_format="4" main_tree_to_execute="Main">'
        f'<BehaviorTree ID="Main">{body}</BehaviorTree>{trees}{MODELS}</root>'
    )
    library = read(text)
    return split(expand(library, "Main"), library, knowledge)


def units(body: str, knowledge: Knowledge | None = None, trees: str = "") -> list[str]:
    """Each unit's label; of one node below the root, too."""
    return [unit.label for unit in pieces(body, knowledge, trees).units()]


def sequence(*children: str) -> str:
    return f"<Sequence>{''.join(children)}</Sequence>"


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (sequence(FIND, GO, WORK), ["Find to Go", "Work"]),
        # What stands between two that share comes along.
        (sequence(WORK, FIND, OTHER, GO), ["Work", "Find to Go"]),
        (sequence(WORK, OTHER), ["Work", "Other"]),
        # Nobody writes it: each robot can be given it.
        (sequence(GO, GO), ["Go", "Go"]),
        # One unit below a decorator is the whole.
        (f"<Inverter>{sequence(FIND, GO)}</Inverter>", ["Inverter"]),
        (f"<Inverter>{sequence(FIND, WORK)}</Inverter>", ["Find", "Work"]),
        # A part of a Fallback and of a Parallel that needs all, but not of others.
        (f"<Fallback>{FIND}{GO}{WORK}</Fallback>", ["Find to Go", "Work"]),
        (f"<Parallel>{FIND}{GO}{WORK}</Parallel>", ["Find to Go", "Work"]),
        (f'<Parallel success_count="2">{FIND}{GO}{WORK}</Parallel>', ["Parallel"]),
        (f'<Parallel success_count="2">{FIND}{OTHER}{WORK}</Parallel>', ["Find", "Other", "Work"]),
        # What only a robot decides.
        (f'<Timeout msec="9">{sequence(WORK, OTHER)}</Timeout>', ["Timeout"]),
        (f"<SequenceWithMemory>{WORK}{OTHER}</SequenceWithMemory>", ["SequenceWithMemory"]),
        (f'<Sequence _while="true">{WORK}{OTHER}</Sequence>', ["Sequence"]),
        (f"<RetryUntilSuccessful num_attempts='{{n}}'>{sequence(WORK, OTHER)}"
         "</RetryUntilSuccessful>", ["RetryUntilSuccessful"]),
        # A condition of its robot stays with what it decides about.
        (sequence(WORK, "<Ok/>", OTHER, GO), ["Work", "Ok to Go"]),
        (f"<ReactiveSequence><Ok/>{WORK}</ReactiveSequence>", ["ReactiveSequence"]),
        (sequence(f"<Fallback><Ok/>{WORK}</Fallback>", OTHER), ["Fallback", "Other"]),
        # What is no work, or may be skipped, goes with its neighbour.
        (sequence(WORK, '<Sleep msec="5"/>', OTHER), ["Work", "Sleep to Other"]),
        (sequence(WORK, OTHER, '<Sleep msec="5"/>'), ["Work", "Other to Sleep"]),
        (sequence("<Work _skipIf='true'/>", OTHER, GO), ["Work to Other", "Go"]),
        # Rounds: an entry that is written first may be forgotten, one that is read first not.
        (f"<Repeat num_cycles='2'>{sequence(FIND, GO, WORK)}</Repeat>", ["Find to Go", "Work"]),
        (f"<Repeat num_cycles='2'>{sequence(GO, FIND, WORK)}</Repeat>", ["Repeat"]),
        (f"<Repeat num_cycles='2'>{sequence(f'<RunOnce>{GO}</RunOnce>', OTHER, WORK)}</Repeat>",
         ["Repeat"]),
        # Which entry that is, nobody can say before.
        (sequence(OTHER, FIND, WORK, "<SetBlackboard value='1' output_key='{k}'/>"),
         ["Other", "Find to SetBlackboard"]),
    ],
)  # fmt: skip
def test_where_a_tree_is_cut(body: str, expected: list[str]) -> None:
    assert units(body) == expected


INNER = '<BehaviorTree ID="In"><Sequence><Find at="{x}"/><Go to="{x}"/><Work/></Sequence>'
INNER += "</BehaviorTree>"


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (sequence('<SubTree ID="In" x="{p}"/>', OTHER), ["Find to Go", "Work", "Other"]),
        (sequence('<SubTree ID="In" x="{p}"/>', GO), ["Sequence"]),
        (sequence('<SubTree ID="In" x="{p}" y="{p}"/>', OTHER), ["In", "Other"]),
        (sequence('<SubTree ID="In" _autoremap="true"/>', '<Go to="{x}"/>'), ["Sequence"]),
        (sequence('<SubTree ID="In"/>', '<Go to="{x}"/>'), ["Find to Go", "Work", "Go"]),
    ],
)
def test_entries_of_subtrees_are_followed(body: str, expected: list[str]) -> None:
    assert units(body, None, INNER) == expected


def test_every_decision_has_its_reason() -> None:
    found = pieces(sequence(FIND, GO, WORK))
    unit, other = found.units()
    assert unit.reasons == ("the entry 'p': Find writes it, Go reads it",)
    assert other.reasons == ()
    assert found.cuts == [
        (
            "Find to Go",
            "Work",
            "as declared, they share nothing of one robot; they share no entry",
        ),
    ]
    (whole,) = pieces(f'<Timeout msec="9">{sequence(WORK, OTHER)}</Timeout>').units()
    assert whole.reasons == ("Timeout is carried out by one robot as a whole",)


def test_what_the_team_knows_and_what_is_a_robots_own() -> None:
    knows = Knowledge(is_asked=lambda node: node.type == "Ok")
    assert units(sequence(WORK, "<Ok/>", OTHER, GO), knows) == ["Work", "Other", "Go"]
    assert units(f"<ReactiveSequence><Ok/>{sequence(WORK, OTHER)}</ReactiveSequence>", knows) == [
        "Work",
        "Other",
    ]

    def holds(node: ExpandedNode) -> list[OwnUse]:
        hand = "the hand"
        return {"Work": [OwnUse(hand)], "Other": [OwnUse(hand, ends=True)]}.get(node.type, [])

    owns = Knowledge(of_robots=holds)
    assert units(sequence(WORK, GO, OTHER), owns) == ["Sequence"]
    # What one puts down, another one can pick up.
    assert units(sequence(WORK, OTHER, WORK, OTHER, GO), owns) == [
        "Work to Other",
        "Work to Other",
        "Go",
    ]

    def moves(node: ExpandedNode) -> list[OwnUse]:
        place = {"Go": [OwnUse("where", begins=True)], "Work": [OwnUse("where")]}
        return place.get(node.type, [])

    # It begins anew with each drive that is certain.
    knows_place = Knowledge(of_robots=moves)
    assert units(sequence(GO, WORK, GO, WORK, OTHER), knows_place) == [
        "Go to Work",
        "Go to Work",
        "Other",
    ]
    assert units(sequence(GO, f"<Fallback>{OTHER}{GO}</Fallback>", WORK), knows_place) == [
        "Sequence"
    ]
