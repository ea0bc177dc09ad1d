"""Every malformed file: what is said of it, on which line, and that nothing crashes."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.findings import Severity
from mrbt_mesh.cli.main import main
from mrbt_mesh.errors import FileError, Problem

FOLDER = Path(__file__).parent / "malformed"
FOLDER_OF_ODD = FOLDER.parent / "odd"
EXPECTED = [
    ("empty", 1, "not well-formed XML: no element in it"),
    ("not_xml", 1, "not well-formed XML"),
    ("binary", 1, "not well-formed XML"),
    ("bad_utf8", 2, "not well-formed XML: not well-formed (invalid token)"),
    ("unclosed_element", 5, "the file ends before <Sequence>, opened in line 3, is closed"),
    ("mismatched_tags", 4, "a closing tag does not match <Sequence>, opened in line 3 (column"),
    ("attribute_twice", 3, "an attribute is given twice"),
    ("attribute_without_quotes", 1, "not well-formed XML"),
    ("two_roots", 2, "something follows the end of the root element"),
    ("unknown_encoding", 1, "encoding 'klingon' cannot be read; save the file as UTF-8"),
    ("entity_expansion", 2, "a document type declaration (<!DOCTYPE ...>) is not allowed"),
    ("external_entity", 1, "document type declaration"),
    ("external_dtd", 1, "document type declaration"),
    ("parameter_entity", 1, "document type declaration"),
    ("nested_too_deep", 259, "nested deeper than 258 levels"),
    ("too_many_attributes", 3, "<Action> has more than 500 attributes"),
    ("wrong_root", 2, "the first element must be <root>, this is <Root>"),
    ("tree_without_id", 5, "<BehaviorTree> needs an ID, since it is not alone"),
    ("tree_without_child", 2, "Main: <BehaviorTree> needs exactly one child, it has 0"),
    ("tree_with_two_children", 2, "needs exactly one child, it has 2"),
    ("tree_named_like_a_node", 2, "'Sequence' is the name of a node; give the tree another ID"),
    ("two_models", 6, "a second <TreeNodesModel>; the first is in line 5"),
    ("include_without_path", 2, "<include> needs the attribute 'path'"),
    ("include_of_itself", 2, "'include_of_itself.xml' includes itself"),
    ("explicit_without_id", 4, "Main/Sequence/x: <Action> needs an ID"),
    ("subtree_without_id", 3, "Main/x: <SubTree> needs an ID"),
    ("wrong_category", 3, "Inverter needs exactly 1 child, it has 0"),
    ("control_without_children", 3, "Main/s: Sequence needs at least 1 child, it has 0"),
    ("decorator_with_two_children", 3, "Inverter needs exactly 1 child, it has 2"),
    ("decorator_without_child", 3, "MyDecorator needs exactly 1 child, it has 0"),
    ("action_with_child", 3, "Move takes no children (<Action>), it has 1"),
    ("subtree_with_child", 3, "<SubTree> takes no children, it has 1"),
    ("if_then_else_with_one_child", 3, "IfThenElse needs 2 to 3 children, it has 1"),
    ("switch_without_default", 3, "Switch2 needs exactly 3 children, it has 2"),
    ("try_catch_with_one_child", 3, "TryCatch needs at least 2 children, it has 1"),
    ("bad_integer", 3, "port 'num_cycles': 'three' is not a whole number"),
    ("bad_unsigned", 3, "port 'msec': '-5' is not a whole number of 0 or more"),
    ("bad_boolean", 3, "port 'then_skip': 'yes' is not a boolean; write true or false"),
    ("bad_list", 3, "port 'queue': 'two' is not a whole number; items are separated by ';'"),
    ("bad_json_list", 3, "is not JSON after 'json:'"),
    ("bad_autoremap", 3, "_autoremap='yes' is not a boolean"),
    (
        "script_unclosed_text",
        3,
        "the script \"a := 'x\" cannot be read: the text is not closed: ' is missing (column 6)",
    ),
    ("script_number_with_letters", 3, "'a' cannot follow the number 12 (column 8)"),
    (
        "precondition_syntax",
        4,
        "_skipIf: the script 'a ==' cannot be read: a value expected, found the end",
    ),
    ("recursion", 7, "B/A: a tree cannot contain itself: A -> B -> A"),
    ("recursion_of_one", 3, "a tree cannot contain itself: Main -> Main"),
    ("model_subtree_without_id", 6, "<SubTree> needs an ID in <TreeNodesModel>"),
]
# Errors in strict checking alone: lenient checking warns.
ONLY_STRICT = [
    ("threshold_too_large", 3, "success_count=3 is above the number of children, 2"),
    ("bad_status", 3, "port 'else': 'success' is not a status"),
    (
        "postcondition_syntax",
        3,
        "_onSuccess: the script '1 := a' cannot be run: only a blackboard entry can stand",
    ),
    ("undefined_entity", 3, "the name 'a&nbsp;b' contains '&'"),
    ("main_tree_unknown", 1, "names 'Mian', which is not a tree; did you mean 'Main'?"),
    ("main_tree_missing", 1, "one of 2 trees has to be named in main_tree_to_execute; known: A, B"),
    ("include_of_nothing", 2, "nowhere.xml' to include"),
    ("include_unknown_package", 2, "package 'no_such_package' is not installed"),
    ("compact_with_id", 3, "<Sequence> takes no ID"),
    (
        "unknown_node",
        3,
        "node 'Sequense' is neither built in nor in <TreeNodesModel>; did you mean 'Sequence'?",
    ),
    ("unknown_port", 3, "Repeat has no port 'num_cycle'; did you mean 'num_cycles'?"),
    ("missing_port", 3, "Timeout needs the port 'msec'"),
    ("port_unknown_to_model", 3, "Move has no port 'gaol'; did you mean 'goal'?"),
    ("unresolved_subtree", 3, "there is no tree 'Elsewhere'; known: Main"),
    ("subtree_port_missing", 3, "port 'goal' of tree 'Go' has to be given"),
    ("subtree_name_twice", 5, "a <SubTree> is called 'x' already, in line 4"),
    ("two_async_children", 3, "takes at most one AsyncSequence"),
    ("tree_name_with_space", 2, "the name 'Open Door' contains a space"),
    ("node_name_with_slash", 3, "the name 'arm/move' contains '/'"),
    ("reserved_tree_name", 2, "'Root' is a reserved name"),
    ("model_subtree_port_without_name", 6, "<input_port> needs the attribute 'name'"),
    ("explicit_below_reactive", 3, "below ReactiveSequence <Action ID='Move'> cannot be"),
    ("version_3_node", 3, "version 3: <SequenceStar> is <SequenceWithMemory> now"),
    ("instruction_inside", 3, "BehaviorTree.CPP reads <?keep ...?> only as the first of"),
]
# Odd, but BehaviorTree.CPP takes them: a warning, in strict checking too.
ODD = [
    ("unknown_format", 1, "BTCPP_format='5' is not known, only 3 and 4; it is read as 4"),
    ("tree_twice", 5, "there is a tree 'Main' already, in"),
    ("model_without_id", 6, "<Action> needs an ID in <TreeNodesModel>"),
    ("model_of_nothing", 6, "<Leaf> is not a kind of node; known: Action, Condition"),
    ("model_of_builtin", 6, "'Inverter' is built in, as <Decorator>"),
    ("model_port_without_name", 6, "<input_port> needs the attribute 'name'"),
    ("model_port_unknown_tag", 6, "<in_port> is not a port; did you mean 'input_port'?"),
    ("model_port_reserved", 6, "'name' is reserved and cannot name a port"),
    ("model_port_with_digit", 6, "the port name '2nd' begins with a digit"),
]
ALL = [*EXPECTED, *ONLY_STRICT]


def found(name: str, is_strict: bool, folder: Path = FOLDER) -> dict[Problem, Severity]:
    """What is found in a file."""
    try:
        _, findings = check_file(folder / f"{name}.xml", is_strict)
    except FileError as error:
        return dict.fromkeys(error.problems, Severity.ERROR)
    return {finding.problem: finding.severity for finding in findings.in_order()}


def test_every_file_is_expected() -> None:
    assert len(ALL) >= 40
    assert sorted(row[0] for row in ALL) == sorted(path.stem for path in FOLDER.iterdir())


@pytest.mark.parametrize(("name", "line", "message"), ALL, ids=[row[0] for row in ALL])
def test_message_line_and_severity(name: str, line: int, message: str) -> None:
    problems = found(name, is_strict=True)
    matching = [p for p in problems if p.line == line and message in str(p)]
    assert matching, "\n".join(map(str, problems))
    assert problems[matching[0]] is Severity.ERROR
    assert matching[0].file.endswith(f"{name}.xml")
    lenient = found(name, is_strict=False)
    severities = [s for p, s in lenient.items() if p.line == line and message in str(p)]
    is_only_strict = (name, line, message) in ONLY_STRICT
    if name == "unknown_node":
        assert not severities  # custom nodes without a model are common
    else:
        assert severities == [Severity.WARNING if is_only_strict else Severity.ERROR]


@pytest.mark.parametrize("row", [ALL[0], ALL[-1]], ids=["error", "rule"])
def test_the_command_ends_with_status_2(row: tuple[str, int, str]) -> None:
    path = FOLDER / f"{row[0]}.xml"
    result = CliRunner().invoke(main, ["tree", "check", str(path), "--strict"])
    assert (result.exit_code, type(result.exception)) == (2, SystemExit)
    assert row[2] in result.stderr
    assert f"{path}:{row[1]}: " in result.stderr


def test_every_odd_file_is_expected() -> None:
    assert sorted(row[0] for row in ODD) == sorted(path.stem for path in FOLDER_OF_ODD.iterdir())


@pytest.mark.parametrize(("name", "line", "message"), ODD, ids=[row[0] for row in ODD])
@pytest.mark.parametrize("is_strict", [False, True], ids=["lenient", "strict"])
def test_what_is_odd_is_only_warned_of(name: str, line: int, message: str, is_strict: bool) -> None:
    problems = found(name, is_strict, FOLDER_OF_ODD)
    assert set(problems.values()) == {Severity.WARNING}
    assert [p.line for p in problems if message in str(p)] == [line]
