"""One test per kind of bad input, reading the message and the line."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.errors import Problem
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_file import FileError, load_mission
from mrbt_mesh.formats.problems import MAX_PROBLEMS, found, path_text
from mrbt_mesh.formats.yaml_source import MAX_YAML_BYTES, decode

# Line numbers below count from the first line of this text, which is line 1.
GOOD = """\
mission: m
parameters: {parts: [1, 2], number: 3, gap: "a b"}
local_tasks:
  weld: {parameters: [part], work: 2}
  paint: {work: 1}
conditions:
  dry: {parameters: [part], default: false}
robot_types:
  A: {capabilities: {weld: 1.5}}
robots:
  A1: A
  A2: {type: A, capabilities: {paint: 1}}
global_tasks:
  fix:
    parameters: [part]
    needs:
      weld($part): {min: 1, max: 2}
subtrees:
  one: {parameters: [part], tree: fix($part)}
tree:
  Sequence:
    - fix(1)
    - Condition: dry(1)
    - SubTree: one(2)
"""


def problems_of(text: str) -> list[Problem]:
    with pytest.raises(FileError) as caught:
        mission_from_yaml(text, "m.yaml", Path("/nowhere"))
    lines = str(caught.value).splitlines()
    assert len(lines) == len(caught.value.problems)
    return caught.value.problems


def test_the_good_one_is_good() -> None:
    assert mission_from_yaml(GOOD, "m.yaml", Path("/nowhere")).name == "m"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        # Keys, shapes and types.
        ("mission: m", "misson: m", 1, "unknown key 'misson'; did you mean 'mission'?"),
        ("mission: m", "mission: m\nassignment: spare_scarce", 2, "unknown key 'assignment'"),
        ("max: 2}", "performance: bids}", 17, "declared or bid is expected, found the text 'bids'"),
        ("max: 2}", "performance: 3}", 17, "declared, bid, or {bid_within_s: 0.5} is expected"),
        ("max: 2}", "performance: {bid_within_s: 0}}", 17, "a number above 0 is expected"),
        ("max: 2}", "performance: {bid_within_s: 11}}", 17, "a number of at most 10 is expected"),
        ("max: 2}", "performance: {within_s: 1}}", 17, "unknown key 'within_s'; did you mean"),
        ("max: 2}", "performance: {bid_within_s: 0.0000001}}", 17, "at most 6 decimals"),
        ("mission: m", "mission: 3", 1, "text is expected, found the number 3"),
        ("mission: m", "mission: m x", 1, "a name is expected: a letter or _"),
        ("mission: m", "mission: m\nprogram: robot.txt", 2, "e.g. robot.py or robot.py:name"),
        ("paint: {work: 1}", "paint: {wrok: 1}", 5, "unknown key 'wrok'; did you mean 'work'?"),
        ("paint: {work: 1}", "paint:", 5, "a mapping (key: value) is expected, found nothing"),
        ("paint: {work: 1}", "2paint: {}", 5, "a name is expected"),
        ("{work: 1}", "{work: fast}", 5, "a number is expected, found the text 'fast'"),
        ("{work: 1}", "{work: true}", 5, "a number is expected, found true"),
        ("{work: 1}", "{work: 0}", 5, "a number above 0 is expected, found the number 0"),
        ("{work: 1}", "{work: .inf}", 5, "a finite number below 2^63 is expected"),
        ("{work: 1}", "{work: .nan}", 5, "a finite number"),
        ("{work: 1}", "{work: 1e400}", 5, "a finite number"),
        ("{work: 1}", "{work: 1e300}", 5, "a number of at most 1e+09 is expected"),
        ("{work: 1}", "{work: 0.1234567}", 5, "at most 6 decimals is expected"),
        ("{work: 1}", "{parameters: part}", 5, "a list is expected, found the text 'part'"),
        ("{work: 1}", "{parameters: [a, a]}", 5, "parameter 'a' is named twice"),
        ("default: false", "default: 0", 7, "true or false is expected, found the number 0"),
        ("tree:\n  Sequence", "tree:\n  Sequnce", 20, "'Sequnce'; did you mean 'Sequence'?"),
        ("- fix(1)", "- {Action: fix(1), Inverter: x}", 22, "exactly one key"),
        ("- fix(1)", "- {}", 22, "exactly one key, its type, found none"),
        ("- fix(1)", "- {Action: go(1, 2)}", 22, "text with commas needs quotes"),
        ("- fix(1)", "- 3", 22, "a node, e.g. {Sequence: [...]}"),
        ("- fix(1)", "- fix(1", 22, "e.g. fix_hw or fix_hw($part)"),
        ("- fix(1)", "- Sequence: []", 22, "at least 1 expected, found 0"),
        ("- fix(1)", "- Sequence: {name: x}", 22, "children, or for_each and do, are missing"),
        ("- fix(1)", "- Sequence: {do: fix(1)}", 22, "for_each is missing, e.g. {item: $items}"),
        ("- fix(1)", "- Sequence: {for_each: {x: $parts}}", 22, "do is missing: the node"),
        ("- fix(1)", "- Sequence: {name: a/b, children: [fix(1)]}", 22, "characters without /"),
        (
            "- fix(1)",
            "- Parallel: {success: most, children: [fix(1)]}",
            22,
            "all, any, or a number",
        ),
        ("- fix(1)", "- Parallel: {success: 0, children: [fix(1)]}", 22, "all, any, or a number"),
        ("- fix(1)", "- Parallel: {success: 2, children: [fix(1)]}", 22, "2 is more than the 1"),
        ("- fix(1)", "- Sequence: {success: 1, children: [fix(1)]}", 22, "unknown key 'success'"),
        ("- fix(1)", "- RetryUntilSuccessful: {attempts: 0, do: fix(1)}", 22, "or -1 for no limit"),
        ("- fix(1)", "- RetryUntilSuccessful: {do: fix(1)}", 22, "the key 'attempts' is missing"),
        ("- fix(1)", "- Repeat: {cycles: true, do: fix(1)}", 22, "a number from 1, or -1"),
        ("- fix(1)", "- Timeout: {seconds: 0, do: fix(1)}", 22, "a number above 0"),
        ("- fix(1)", "- Timeout: {seconds: 0.0000001, do: fix(1)}", 22, "at most 6 decimals"),
        ("- fix(1)", "- Inverter: [fix(1)]", 22, "a node, e.g."),
        # Robots.
        (
            "weld: 1.5",
            "wled: 1.5",
            9,
            "unknown capability 'wled': no local task is called 'wled'; did",
        ),
        ("weld: 1.5", "weld: 0", 9, "a number above 0"),
        ("weld: 1.5", "weld: -1", 9, "a number above 0 is expected, found the number -1"),
        ("weld: 1.5", "weld: 1000001", 9, "a number of at most 1e+06 is expected"),
        ("weld: 1.5", "weld: 1e-7", 9, "at most 6 decimals"),
        ("weld: 1.5", "weld: null", 9, "a number is expected, found nothing"),
        ("weld: 1.5", "'weld(1,2)': 1", 9, "'weld' takes 1 argument (part), found 2"),
        ("weld: 1.5", "weld($part): 1", 9, "e.g. do_diagnosis or do_diagnosis(3)"),
        ("weld: 1.5", "weld(1): 1, weld( 1): 2", 9, "capability 'weld(1)' is given twice"),
        ("A1: A", "A1: B", 11, "unknown robot type 'B'; known: A"),
        ("type: A", "type: B", 12, "unknown robot type 'B'"),
        ("A1: A", "A1: 7", 11, "a robot type, or {type: ..., capabilities: {...}}"),
        ("A1: A", "A 1: A", 11, "a robot id is expected: 1 to 32 letters"),
        ("paint: 1}}", "paint: null}}", 12, "type 'A' has no capability 'paint' to take away"),
        ("paint: 1}}", "flying: 2}}", 12, "unknown capability 'flying'"),
        # Global tasks.
        ("min: 1, max: 2", "min: 3, max: 2", 17, "min (nu) is 3, but max (mu) is 2"),
        ("min: 1, max: 2", "min: -1, max: 2", 17, "a number of at least 0 is expected"),
        ("min: 1, max: 2", "min: 0, max: 2", 16, "fix would succeed at once: give one of its"),
        (
            "max: 2}",
            "max: 2}\n      paint: {min: 0}",
            18,
            "give max (mu), the number of robots that may help",
        ),
        ("min: 1, max: 2", "min: 1.0, max: 2", 17, "a whole number is expected"),
        ("min: 1, max: 2", "max: 1001", 17, "a number of at most 1000 is expected"),
        (
            "weld($part): {",
            "wled($part): {",
            17,
            "'wled' is not a declared local task; did you mean",
        ),
        ("weld($part): {", "weld: {", 17, "local task 'weld' takes 1 argument (part), found 0"),
        ("weld($part): {", "weld($prt): {", 17, "unknown parameter $prt; did you mean 'part'?"),
        ("weld($part): {", "weld($parts): {", 17, "in fix(1): an argument is text or a number"),
        ("weld($part): {", "weld(1): {}\n      weld($part): {", 18, "fix(1) needs weld(1) twice"),
        ("max: 2}", "max: 2}\n    failure: often", 18, "resilient, paper or first is expected"),
        ("max: 2}", "max: 2}\n    blocked: never", 18, "wait is expected, found the text 'never'"),
        ("max: 2}", "max: 2}\n    blocked: 3", 18, "wait, or {fail_after_s: 20} is expected"),
        ("max: 2}", "max: 2}\n    blocked: {fail_after_s: 0}", 18, "a number above 0"),
        ("max: 2}", "max: 2}\n    preemptive: maybe", 18, "true or false is expected"),
        # Names in the tree.
        ("- fix(1)", "- fux(1)", 22, "'fux' is not a declared global task; did you mean 'fix'?"),
        ("- fix(1)", "- fix", 22, "global task 'fix' takes 1 argument (part), found 0"),
        ("- fix(1)", "- dry(1)", 22, "'dry' is a condition; write {Condition: dry(1)}"),
        ("- fix(1)", "- fix($nummer)", 22, "unknown parameter $nummer; did you mean 'number'?"),
        ("- fix(1)", "- fix(5$)", 22, "a $ needs a parameter's name after it"),
        ("- fix(1)", "- fix($parts)", 22, "an argument is text or a number, found a list"),
        ("- fix(1)", "- fix($gap)", 22, "an argument has 1 to 64 letters"),
        ("dry(1)", "wet(1)", 23, "'wet' is not a declared condition; known: dry"),
        ("dry(1)", "dry", 23, "condition 'dry' takes 1 argument (part), found 0"),
        ("one(2)", "two(2)", 24, "'two' is not a declared subtree; known: one"),
        ("one(2)", "one(2, 3)", 24, "subtree 'one' takes 1 argument (part), found 2"),
        ("tree: fix($part)", "tree: fix($prt)", 19, "unknown parameter $prt"),
        ("tree: fix($part)", "tree: {SubTree: one($part)}", 19, "cycle of subtrees: one -> one"),
        (
            "tree: fix($part)",
            "tree: {Sequence: [nope]}",
            19,
            "'nope' is not a declared global task",
        ),
    ],
)
def test_a_mistake_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    assert old in GOOD
    problems = problems_of(GOOD.replace(old, new, 1))
    assert any(p.line == line and message in p.message for p in problems), problems


@pytest.mark.parametrize(
    ("loop", "message"),
    [
        ("for_each: {x: 3}", "a list or the name of a parameter is expected"),
        ("for_each: {x: parts}", "a list or the name of a parameter is expected"),
        ("for_each: {x: $number}", "for_each x: a list is expected, but $number is the number 3"),
        ("for_each: {x: $prts}", "unknown parameter $prts; did you mean 'parts'?"),
        ("for_each: {x: [[1]]}", "text, a number, true or false is expected, found a list"),
        ("for_each: {x: []}", "no children: every list that for_each goes over is empty"),
        ("for_each: {}", "at least 1 expected"),
        ("for_each: {x: $parts}, success: 3", "success: 3 is more than the 2 children; use 1 to 2"),
    ],
)
def test_mistakes_in_for_each(loop: str, message: str) -> None:
    text = GOOD.replace("- fix(1)", f"- Parallel: {{{loop}, do: fix($x)}}")
    (problem,) = problems_of(text)
    assert problem.line == 22
    assert message in problem.message


def test_a_longer_cycle_of_subtrees_is_named() -> None:
    cycle = (
        "subtrees:\n  a: {tree: {SubTree: b}}\n  b: {tree: {SubTree: c}}\n  c: {tree: {SubTree: a}}"
    )
    (problem,) = problems_of(GOOD.replace("subtrees:", cycle))
    assert "cycle of subtrees: a -> b -> c -> a" in problem.message
    assert (problem.line, problem.path) == (21, "subtrees/c/tree/SubTree")


def test_a_duplicate_robot_id_is_named_with_both_lines() -> None:
    (problem,) = problems_of(GOOD.replace("  A1: A\n", "  A1: A\n  A2: A\n"))
    assert problem.line == 13
    assert problem.path == "robots/A2"
    assert "'A2' is given twice, first on line 12" in problem.message


def test_a_team_has_robots() -> None:
    robots = GOOD[GOOD.index("robots:") : GOOD.index("global_tasks:")]
    (problem,) = problems_of(GOOD.replace(robots, "robots: {}\n"))
    assert problem.message == "at least 1 expected, found 0"


def test_a_duplicate_section_is_named_with_both_lines() -> None:
    (problem,) = problems_of(GOOD + "robots: {}\n")
    assert "'robots' is given twice, first on line 10" in problem.message


def test_missing_sections_are_all_named() -> None:
    messages = [problem.message for problem in problems_of("mission: m\n")]
    missing = ["local_tasks", "robot_types", "robots", "tree"]
    assert messages == [f"the key '{key}' is missing" for key in missing]


def test_many_mistakes_are_found_in_one_pass_in_the_order_of_the_file() -> None:
    text = GOOD
    for old, new in [
        ("mission: m", "mission: m\nprogramm: r.py"),
        ("{work: 1}", "{work: -1}"),
        ("weld: 1.5", "wled: 1.5"),
        ("A1: A", "A1: B"),
        ("min: 1,", "min: 3,"),
        ("dry(1)", "wet(1)"),
    ]:
        text = text.replace(old, new, 1)
    problems = problems_of(text)
    assert [problem.line for problem in problems] == [2, 6, 10, 12, 18, 24]
    assert str(problems[0]) == (
        "m.yaml:2: programm: unknown key 'programm'; did you mean 'program'?"
    )


def test_wrong_values_do_not_hide_a_wrong_shape() -> None:
    nested = "- Sequence: {do: {Timeout: {seconds: -1, do: fix(1)}}}"
    messages = [problem.message for problem in problems_of(GOOD.replace("- fix(1)", nested))]
    assert any("a number above 0" in message for message in messages)
    assert any("for_each is missing" in message for message in messages)


def test_a_mistake_in_a_subtree_used_twice_is_named_once() -> None:
    text = GOOD.replace("fix($part)}", "fix($gap)}").replace("- fix(1)", "- SubTree: one(1)")
    assert [problem.line for problem in problems_of(text)] == [19]


def test_endless_mistakes_are_cut_off() -> None:
    text = GOOD + "".join(f"extra{i}: 1\n" for i in range(5000))
    problems = problems_of(text)
    assert len(problems) == MAX_PROBLEMS + 1
    assert str(problems[-1]) == "m.yaml: and more problems"


# What YAML itself allows or not.


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", 0, "the file is empty"),
        ("# nothing\n", 0, "the file is empty"),
        ("- a\n", 1, "a mission is expected (mission: ..., robots: ...), found a list"),
        ("hello", 1, "found the text 'hello'"),
        ("a: [1,\nb: 2", 1, "not valid YAML: the [ that opens here is not closed; add ]"),
        ("a: 1\nb: @\n", 2, "not valid YAML: text that begins with @ needs quotes"),
        ("a: 1\n--- \nb: 1\n", 2, "not valid YAML: a second document begins here (---)"),
        ("a: *b\n", 1, "not valid YAML: found undefined alias"),
        ("mission: &a [*a]\n", 1, "the alias *a contains itself"),
        ("a: 1\nb: \0\n", 2, "not valid YAML: the control character U+0000"),
        ("a: !!python/object:x.Y {}\n", 1, "python/object:x.Y is not supported"),
        ("a: !secret 3\n", 1, "the tag !secret is not supported"),
        ("a: &x {b: 1}\nc:\n  <<: *x\n", 3, "merge keys (<<) are not supported"),
        ("a: 1\n? [b]\n: 1\n", 2, "a key must be a name"),
        ("a: 1\ntrue: 1\n", 2, "a key must be a name"),
        ('a: "\\ud800"\n', 1, "half a surrogate pair"),
        ("a: " + "9" * 5000, 1, "a finite number below 2^63"),
    ],
)
def test_yaml_that_is_no_mission(text: str, line: int, message: str) -> None:
    problems = problems_of(text)
    assert any(p.line == line and message in p.message for p in problems), problems


def test_aliases_may_be_used() -> None:
    # The name of an anchor may be used again, as YAML says.
    text = GOOD.replace("- fix(1)", "- &again fix(1)\n    - *again").replace(
        "A1: A", "A1: &again A"
    )
    actions = mission_from_yaml(text, "m.yaml", Path("/nowhere")).tree.actions()
    assert [node.subject for node in actions] == ["fix(1)", "fix(1)", "fix(2)"]


def test_a_billion_laughs_are_stopped() -> None:
    laughs = ["a0: &a0 [ha]"]
    laughs += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    (problem,) = problems_of("\n".join(laughs))
    assert "more than 100000 values once aliases are unfolded" in problem.message


@pytest.mark.parametrize("opening", ["[", "{a: ", "- ", "? ", "!!x [", "&a ["])
def test_deep_nesting_is_stopped(opening: str) -> None:
    (problem,) = problems_of(("mission:\n  " + opening * 1000)[:10_000])
    assert "nested deeper than 200 levels" in problem.message or "YAML" in problem.message


def test_deep_nesting_in_valid_yaml_is_stopped() -> None:
    for levels in (199, 260):
        (problem, *_) = problems_of(f"mission: {'[' * levels}{']' * levels}\n")
        assert ("nested deeper than 200 levels" in problem.message) == (levels > 200)


# Limits of the tree.


def deep(levels: int) -> str:
    """A mission whose tree has this many levels."""
    tree = "{Sequence: {children: [" * (levels - 1) + "fix(1)" + "]}}" * (levels - 1)
    return GOOD.partition("tree:\n  Seq")[0] + f"tree: {tree}\n"


def test_the_tree_may_have_64_levels_and_no_more() -> None:
    assert len(mission_from_yaml(deep(64), "m.yaml", Path("/nowhere")).tree.nodes) == 64
    (problem,) = problems_of(deep(65))
    assert "the tree is deeper than 64 levels here" in problem.message
    assert len(problem.path) < 200


def test_subtrees_that_double_are_stopped_at_the_limit_of_nodes() -> None:
    double = "".join(
        f"  s{i}: {{tree: {{Sequence: [SubTree: s{i + 1}, SubTree: s{i + 1}]}}}}\n"
        for i in range(30)
    )
    text = GOOD.partition("subtrees:")[0] + "subtrees:\n" + double + "  s30: {tree: fix(1)}\n"
    (problem,) = problems_of(text + "tree: {SubTree: s0}\n")
    assert "the tree has more than 20000 nodes once expanded" in problem.message


def test_there_may_be_10000_global_tasks_and_no_more() -> None:
    numbers = ", ".join(str(i) for i in range(10_001))
    loop = f"- Parallel: {{for_each: {{x: [{numbers}]}}, do: fix($x)}}"
    (problem, *_) = problems_of(GOOD.replace("- fix(1)", loop))
    assert "more than 10000 global tasks once expanded" in problem.message


def test_there_may_be_1000_robots_and_no_more() -> None:
    robots = "".join(f"  R{i}: A\n" for i in range(999))
    (problem,) = problems_of(GOOD.replace("  A1: A\n", robots + "  A1: A\n"))
    assert "at most 1000 expected, found 1001" in problem.message


def test_the_number_of_arguments_is_limited() -> None:
    (problem,) = problems_of(GOOD.replace("fix(1)", f"fix({','.join('123456789')})"))
    assert "at most 8 arguments" in problem.message


# Files.


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("m.yaml", b"a: \xff\n", "m.yaml:1: not a text file in UTF-8 (byte 3 is 0xff)"),
        ("m.yaml", b"a: 1\nb: \xe4\n", "m.yaml:2: not a text file in UTF-8"),
        ("m.yaml", "a: 1".encode("utf-16"), "not a text file in UTF-8"),
        ("m.yaml", b"\0" * 100, "not valid YAML"),
        ("m.yaml", b" " * (MAX_YAML_BYTES + 1), "larger than the limit of 1048576 bytes"),
        ("m.json", b"\xff", "not a text file in UTF-8"),
        ("m.json", b"", "m.json:1: not valid JSON"),
        ("m.txt", b"mission: m", "a mission file ends in .yaml, .yml or .json"),
        ("mission", b"mission: m", "a mission file ends in .yaml, .yml or .json"),
    ],
)
def test_unusable_files(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError) as caught:
        load_mission(tmp_path / name)
    assert message in str(caught.value)


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="there is no such file"):
        load_mission(tmp_path / "m.yaml")
    with pytest.raises(FileError, match="there is no such file"):
        load_mission(tmp_path / "no" / "m.json")
    folder = tmp_path / "folder.yaml"
    folder.mkdir()
    with pytest.raises(FileError, match="not a file; give the file itself"):
        load_mission(folder)
    with pytest.raises(FileError):
        load_mission(Path("\0.yaml"))
    with pytest.raises(FileError, match="cannot be read"):
        load_mission(tmp_path / ("x" * 5000 + ".yaml"))


def test_a_file_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(GOOD)

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    # Not by its mode, which does not stop root.
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(FileError, match="cannot be read: Permission denied"):
        load_mission(file)


def test_a_byte_order_mark_does_not_disturb() -> None:
    assert decode(b"\xef\xbb\xbfmission: m", "m.yaml") == "mission: m"


def test_paths_count_from_1() -> None:
    assert path_text(("tree", "Sequence", 1, "Action")) == "tree/Sequence[2]/Action"
    assert path_text(()) == ""


def test_values_are_shown_short_and_on_one_line() -> None:
    assert found("a\nb") == "the text 'a\\nb'"
    assert len(found("x" * 1000)) < 80


# Whatever is in the file, the only exception is FileError.

_pieces = st.sampled_from(
    [
        *"{}[]:,-?&*!|>'\"%@`# \n$()=\t\ufeff",
        *("\n  ", ": ", "- ", "&a ", "*a", "<<", "...", "%YAML 1.1\n---\n"),
        *("tree", "Sequence", "fix($x)", "robots", "A1"),
        *("1", "null", "~", "1e9", "0x", "0o9", "2001-01-01"),
        *("!!int ", "!!float x", "!!binary ", "!!set "),
    ]
)


@given(st.lists(_pieces, max_size=40).map("".join))
def test_no_text_raises_anything_else(text: str) -> None:
    with pytest.raises(FileError):
        mission_from_yaml(text, "m.yaml", Path("/nowhere"))


@given(st.data())
def test_no_damage_to_a_good_mission_raises_anything_else(data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(GOOD)))
    length = data.draw(st.integers(0, 12))
    text = GOOD[:start] + data.draw(_pieces) + GOOD[start + length :]
    message = ""
    try:
        mission_from_yaml(text, "m.yaml", Path("/nowhere"))
    except FileError as error:
        message = str(error)
    assert all(line.startswith("m.yaml") for line in message.splitlines())
