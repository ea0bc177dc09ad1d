"""What nodes read before they have written it, by the shape of a tree."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.entry_flow import entry_flow
from mrbt_mesh.btcpp.files.expand import expand
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of

SEE, TAKE = '<See what="{x}"/>', '<Take what="{x}"/>'
BOTH = f"<Sequence>{SEE}{TAKE}</Sequence>"


def flow(body: str) -> tuple[set[str], set[str]]:
    text = (
        '<root BTCPP_format="4" main_tree_to_execute="Main">'
        f'<BehaviorTree ID="Main">{body}</BehaviorTree>'
        f'<BehaviorTree ID="In">{SEE}</BehaviorTree>'
        '<TreeNodesModel><Action ID="See"><output_port name="what"/></Action>'
        '<Action ID="Take"><input_port name="what"/></Action></TreeNodesModel></root>'
    )
    findings = Findings()
    library = library_of(parse_document(text, "t.xml"), findings)
    check_library(library, findings)
    findings.raise_errors()
    found = entry_flow(expand(library, "Main").root, library)
    return set(found.kept), set(found.written)


@pytest.mark.parametrize(
    ("body", "kept", "written"),
    [
        (SEE, "", "x"),
        (TAKE, "x", ""),
        ('<Unknown what="{x}"/>', "x", ""),
        (BOTH, "", "x"),
        (f"<Sequence>{TAKE}{SEE}</Sequence>", "x", "x"),
        (f"<ReactiveSequence>{SEE}{TAKE}</ReactiveSequence>", "", "x"),
        (f"<Fallback>{SEE}{TAKE}</Fallback>", "x", ""),
        (f"<Fallback>{SEE}{SEE}</Fallback>", "", "x"),
        (f"<Sequence><Fallback>{SEE}<AlwaysSuccess/></Fallback>{TAKE}</Sequence>", "x", ""),
        (f"<Sequence><Inverter>{SEE}</Inverter>{TAKE}</Sequence>", "x", ""),
        (f'<Sequence><Timeout msec="9">{SEE}</Timeout>{TAKE}</Sequence>', "", "x"),
        (f"<Parallel>{SEE}{TAKE}</Parallel>", "x", ""),
        (f"<IfThenElse>{SEE}{TAKE}<AlwaysSuccess/></IfThenElse>", "", ""),
        (f"<IfThenElse><AlwaysSuccess/>{SEE}{BOTH}</IfThenElse>", "", "x"),
        (f"<IfThenElse><AlwaysSuccess/>{SEE}</IfThenElse>", "", ""),
        (f'<Sequence><See what="{{x}}" _skipIf="1"/>{TAKE}</Sequence>', "x", ""),
        (f'<Sequence><Script code="x := 1"/>{TAKE}</Sequence>', "", "x"),
        (f'<Sequence><Script code="x += 1"/>{TAKE}</Sequence>', "x", ""),
        (f'<Sequence><SetBlackboard value="1" output_key="x"/>{TAKE}</Sequence>', "", "x"),
        (f'<Sequence><UnsetBlackboard key="x"/>{TAKE}</Sequence>', "x", ""),
        (f'<Sequence><SubTree ID="In" x="{{x}}"/>{TAKE}</Sequence>', "", "x"),
        (f'<Sequence><SubTree ID="In" x="{{y}}"/>{TAKE}</Sequence>', "x", "y"),
        (
            f'<PipelineSequence><RateController hz="1">{SEE}</RateController>{TAKE}'
            "</PipelineSequence>",
            "",
            "x",
        ),
        (f'<GoalUpdater input_goal="{{y}}" output_goal="{{x}}">{TAKE}</GoalUpdater>', "y", ""),
        (f'<LoopString queue="1;2" value="{{x}}">{TAKE}</LoopString>', "", ""),
    ],
)
def test_what_is_kept_and_what_is_surely_written(body: str, kept: str, written: str) -> None:
    assert flow(body) == (set(kept), set(written))
