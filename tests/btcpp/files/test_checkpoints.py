"""Which nodes are checkpoints, by their numbers, and which cannot be."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp.files.checkpoints import checkpoints
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.expand import expand
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from mrbt_mesh.errors import FileError

HERE = ' _checkpoint="true"'


def found(body: str) -> list[int]:
    text = (
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">'
        f'{body}</BehaviorTree><BehaviorTree ID="In"><Sequence><A{HERE}/><B/></Sequence>'
        "</BehaviorTree></root>"
    )
    library = library_of(parse_document(text, "t.xml"), Findings())
    return checkpoints(expand(library, "Main").root, library)


@pytest.mark.parametrize(
    ("body", "numbers"),
    [
        ("<Sequence><A/><B/></Sequence>", []),
        (f"<Sequence><A{HERE}/><B/></Sequence>", [2]),
        ('<Sequence><A _checkpoint="false"/><B/></Sequence>', []),
        ('<Sequence><A/><SubTree ID="In"/><B/></Sequence>', [5]),
        (f'<AsyncSequence><SubTree ID="In"{HERE}/><B/></AsyncSequence>', [2, 4]),
        (f'<Sequence><Fallback{HERE}><A x="{{x}}"/><B/></Fallback><C y="{{y}}"/></Sequence>', [2]),
    ],
)
def test_checkpoints_are_numbered_as_the_executor_does(body: str, numbers: list[int]) -> None:
    assert found(body) == numbers


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (f"<Inverter><A{HERE}/></Inverter>", "is below Main/Inverter; only Sequences"),
        (f'<Sequence _while="1"><A{HERE}/></Sequence>', "Main/Sequence, which has _while"),
        (f'<Sequence><A x="{{x}}"{HERE}/><B x="{{x}}"/></Sequence>', "B reads {x}, which was"),
        ('<Sequence><A _checkpoint="soon"/></Sequence>', "'soon' is neither true nor false"),
    ],
)
def test_one_after_which_nobody_could_go_on_is_refused(body: str, message: str) -> None:
    with pytest.raises(FileError, match="_checkpoint") as caught:
        found(body)
    assert message in str(caught.value)
