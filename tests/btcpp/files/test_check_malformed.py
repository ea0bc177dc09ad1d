"""Every malformed file: what is said of it, on which line, and that nothing crashes.

The last column says whether only strict checking calls it an error; lenient checking warns.
"""

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
    ("empty", 1, "not well-formed XML: no element in it", False),
    ("not_xml", 1, "not well-formed XML", False),
    ("binary", 1, "not well-formed XML", False),
    ("bad_utf8", 2, "not well-formed XML: not well-formed (invalid token)", False),
    ("unclosed_element", 5, "the file ends before <Sequence>, opened in line 3, is closed", False),
    (
        "mismatched_tags",
        4,
        "a closing tag does not match <Sequence>, opened in line 3 (column",
        False,
    ),
    ("attribute_twice", 3, "an attribute is given twice", False),
    ("attribute_without_quotes", 1, "not well-formed XML", False),
    ("two_roots", 2, "something follows the end of the root element", False),
    ("undefined_entity", 3, "the name 'a&nbsp;b' contains '&'", True),
    ("unknown_encoding", 1, "encoding 'klingon' cannot be read; save the file as UTF-8", False),
    ("entity_expansion", 2, "a document type declaration (<!DOCTYPE ...>) is not allowed", False),
    ("external_entity", 1, "document type declaration", False),
    ("external_dtd", 1, "document type declaration", False),
    ("parameter_entity", 1, "document type declaration", False),
    ("nested_too_deep", 259, "nested deeper than 258 levels", False),
    ("too_many_attributes", 3, "<Action> has more than 500 attributes", False),
    ("wrong_root", 2, "the first element must be <root>, this is <Root>", False),
    ("tree_without_id", 5, "<BehaviorTree> needs an ID, since it is not alone", False),
    ("tree_without_child", 2, "Main: <BehaviorTree> needs exactly one child, it has 0", False),
    ("tree_with_two_children", 2, "needs exactly one child, it has 2", False),
    (
        "tree_named_like_a_node",
        2,
        "'Sequence' is the name of a node; give the tree another ID",
        False,
    ),
    ("two_models", 6, "a second <TreeNodesModel>; the first is in line 5", False),
    ("main_tree_unknown", 1, "names 'Mian', which is no tree; did you mean 'Main'?", True),
    (
        "main_tree_missing",
        1,
        "one of 2 trees has to be named in main_tree_to_execute; known: A, B",
        True,
    ),
    ("include_without_path", 2, "<include> needs the attribute 'path'", False),
    ("include_of_nothing", 2, "nowhere.xml' to include", True),
    ("include_of_itself", 2, "'include_of_itself.xml' includes itself", False),
    ("include_unknown_package", 2, "package 'no_such_package' is not installed", True),
    ("explicit_without_id", 4, "Main/Sequence/x: <Action> needs an ID", False),
    ("subtree_without_id", 3, "Main/x: <SubTree> needs an ID", False),
    ("compact_with_id", 3, "<Sequence> takes no ID", True),
    ("wrong_category", 3, "Inverter needs exactly 1 child, it has 0", False),
    (
        "unknown_node",
        3,
        "node 'Sequense' is neither built in nor in <TreeNodesModel>; did you mean 'Sequence'?",
        True,
    ),
    ("control_without_children", 3, "Main/s: Sequence needs at least 1 child, it has 0", False),
    ("decorator_with_two_children", 3, "Inverter needs exactly 1 child, it has 2", False),
    ("decorator_without_child", 3, "MyDecorator needs exactly 1 child, it has 0", False),
    ("action_with_child", 3, "Move takes no children (<Action>), it has 1", False),
    ("subtree_with_child", 3, "<SubTree> takes no children, it has 1", False),
    ("if_then_else_with_one_child", 3, "IfThenElse needs 2 to 3 children, it has 1", False),
    ("switch_without_default", 3, "Switch2 needs exactly 3 children, it has 2", False),
    ("try_catch_with_one_child", 3, "TryCatch needs at least 2 children, it has 1", False),
    ("threshold_too_large", 3, "success_count=3 is above the number of children, 2", False),
    ("unknown_port", 3, "Repeat has no port 'num_cycle'; did you mean 'num_cycles'?", True),
    ("missing_port", 3, "Timeout needs the port 'msec'", True),
    ("port_unknown_to_model", 3, "Move has no port 'gaol'; did you mean 'goal'?", True),
    ("bad_integer", 3, "port 'num_cycles': 'three' is not a whole number", False),
    ("bad_unsigned", 3, "port 'msec': '-5' is not a whole number of 0 or more", False),
    ("bad_boolean", 3, "port 'then_skip': 'yes' is not a boolean; write true or false", False),
    ("bad_status", 3, "port 'else': 'success' is not a status", False),
    ("bad_list", 3, "port 'queue': 'two' is not a whole number; items are separated by ';'", False),
    ("bad_json_list", 3, "is no JSON after 'json:'", False),
    ("bad_autoremap", 3, "_autoremap='yes' is not a boolean", False),
    (
        "script_unclosed_text",
        3,
        "the script \"a := 'x\" cannot be read: the text is not closed: ' is missing (column 6)",
        False,
    ),
    ("script_number_with_letters", 3, "'a' cannot follow the number 12 (column 8)", False),
    (
        "precondition_syntax",
        4,
        "_skipIf: the script 'a ==' cannot be read: a value expected, found the end",
        False,
    ),
    (
        "postcondition_syntax",
        3,
        "_onSuccess: the script '1 := a' cannot be run: only a blackboard entry can stand",
        False,
    ),
    ("recursion", 7, "B/A: a tree cannot contain itself: A -> B -> A", False),
    ("recursion_of_one", 3, "a tree cannot contain itself: Main -> Main", False),
    ("unresolved_subtree", 3, "there is no tree 'Elsewhere'; known: Main", True),
    ("subtree_port_missing", 3, "port 'goal' of tree 'Go' has to be given", True),
    ("subtree_name_twice", 5, "a <SubTree> is called 'x' already, in line 4", True),
    ("two_async_children", 3, "takes at most one AsyncSequence", True),
    ("tree_name_with_space", 2, "the name 'Open Door' contains a space", True),
    ("node_name_with_slash", 3, "the name 'arm/move' contains '/'", True),
    ("reserved_tree_name", 2, "'Root' is a reserved name", True),
    ("model_subtree_without_id", 6, "<SubTree> needs an ID in <TreeNodesModel>", False),
    ("model_subtree_port_without_name", 6, "<input_port> needs the attribute 'name'", True),
    ("explicit_below_reactive", 3, "below ReactiveSequence <Action ID='Move'> cannot be", True),
    ("version_3_node", 3, "version 3: <SequenceStar> is <SequenceWithMemory> now", True),
    ("instruction_inside", 3, "BehaviorTree.CPP reads <?keep ...?> only as the first of", True),
]
# Odd, but BehaviorTree.CPP takes them: a warning, in strict checking too.
ODD = [
    ("unknown_format", 1, "BTCPP_format='5' is not known, only 3 and 4; it is read as 4"),
    ("tree_twice", 5, "there is a tree 'Main' already, in"),
    ("model_without_id", 6, "<Action> needs an ID in <TreeNodesModel>"),
    ("model_of_nothing", 6, "<Leaf> is no kind of node; known: Action, Condition"),
    ("model_of_builtin", 6, "'Inverter' is built in, as <Decorator>"),
    ("model_port_without_name", 6, "<input_port> needs the attribute 'name'"),
    ("model_port_unknown_tag", 6, "<in_port> is no port; did you mean 'input_port'?"),
    ("model_port_reserved", 6, "'name' is reserved and cannot name a port"),
    ("model_port_with_digit", 6, "the port name '2nd' begins with a digit"),
]
EVERY = pytest.mark.parametrize(
    ("name", "line", "message", "only_strict"), EXPECTED, ids=[row[0] for row in EXPECTED]
)


def found(name: str, is_strict: bool, folder: Path = FOLDER) -> dict[Problem, Severity]:
    """What is found in a file."""
    try:
        _, findings = check_file(folder / f"{name}.xml", is_strict)
    except FileError as error:
        return dict.fromkeys(error.problems, Severity.ERROR)
    return {finding.problem: finding.severity for finding in findings.in_order()}


def test_every_file_is_expected() -> None:
    assert len(EXPECTED) >= 40
    assert sorted(row[0] for row in EXPECTED) == sorted(path.stem for path in FOLDER.iterdir())


@EVERY
def test_message_line_and_severity(name: str, line: int, message: str, only_strict: bool) -> None:
    problems = found(name, is_strict=True)
    matching = [p for p in problems if p.line == line and message in str(p)]
    assert matching, "\n".join(map(str, problems))
    assert problems[matching[0]] is Severity.ERROR
    assert matching[0].file.endswith(f"{name}.xml")
    lenient = found(name, is_strict=False)
    severities = [s for p, s in lenient.items() if p.line == line and message in str(p)]
    if name == "unknown_node":
        assert not severities  # custom nodes without a model are common
    else:
        assert severities == [Severity.WARNING if only_strict else Severity.ERROR]


@pytest.mark.parametrize("row", [EXPECTED[0], EXPECTED[-1]], ids=["error", "rule"])
def test_the_command_ends_with_status_2(row: tuple[str, int, str, bool]) -> None:
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
