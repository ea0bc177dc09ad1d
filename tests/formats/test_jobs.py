"""Types of jobs in mission files: what comes of them, and what is wrong with them."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Kind, NodeSpec
from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.jobs import OpenJob, with_jobs
from mrbt_mesh.core.mission.mission import JobParameter, Mission, SameRobotAs
from mrbt_mesh.errors import FileError, Problem
from mrbt_mesh.features.constraints.kinds import constraints_of
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.cautions import cautions
from mrbt_mesh.formats.mission_file import mission_warnings
from mrbt_mesh.formats.mission_writer import tree_data

# Line numbers below count from the first line of this text, which is line 1.
GOOD = """\
mission: m
ends: never
parameters: {docks: [dock_1, dock_2], number: 3}
travel:
  places: {dock_1: [0, 0], dock_2: [1, 0], shelf_1: [3, 4], shelf_2: [4, 4]}
  speed: 1
  start: dock_1
local_tasks:
  lift: {parameters: [number], at: shelf_$number}
  stow:
    parameters: [place]
    at: $place
  call: {effects: {called: true}}
conditions:
  clear: {parameters: [place]}
  called: {}
robot_types:
  cart: {capabilities: {lift: 1, stow: 1, call: 1}}
robots: {A1: cart, A2: cart}
global_tasks:
  fetch: {parameters: [number], needs: {lift($number): {}}}
  bring:
    parameters: [number, to]
    needs: {stow($to): {same_robot_as: {global_task: fetch($number)}}, call: {}}
  look: {parameters: [place], needs: {call: {}}}
subtrees:
  fetch_all: {parameters: [number], tree: {Sequence: [fetch($number), look(shelf_$number)]}}
jobs:
  deliver:
    parameters:
      number: {min: 1, max: 2}
      to: $docks
    priority: 5
    deadline_s: 600
    attempts: 2
    tree:
      Sequence:
        - Condition: clear($to)
        - SubTree: fetch_all($number)
        - 'bring($number, $to)'
        - look(dock_1)
  inspect:
    parameters: {where: place}
    tree: look($where)
tree:
  Sequence:
    - Condition: called
    - Jobs: {types: [inspect, deliver], at_most: 7}
"""
J1 = OpenJob("j1", "deliver", ("2", "dock_2"))
J2 = OpenJob("j2", "inspect", ("shelf_1",))


def load(text: str = GOOD, folder: Path = Path("/nowhere")) -> Mission:
    return mission_from_yaml(text, "m.yaml", folder)


def changed(*changes: tuple[str, str]) -> str:
    text = GOOD
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def problems_of(text: str) -> list[Problem]:
    with pytest.raises(FileError) as caught:
        load(text)
    return caught.value.problems


def subjects(spec: NodeSpec) -> list[str]:
    """Those of all leaves, in tree order."""
    return [each for child in spec.children for each in subjects(child)] or [spec.subject]


def test_a_type_has_parameters_usual_values_and_tasks_with_placeholders() -> None:
    jobs = load().jobs
    assert list(jobs) == ["deliver", "inspect"]
    deliver = jobs["deliver"]
    assert deliver.parameters == (
        JobParameter("number", (), 1, 2),
        JobParameter("to", ("dock_1", "dock_2")),
    )
    assert (deliver.priority, deliver.deadline_us, deliver.ends_mission) == (5, 600_000_000, False)
    assert list(deliver.global_tasks) == [
        "fetch({number})",
        "look(shelf_{number})",
        "bring({number},{to})",
    ]
    before = deliver.global_tasks["bring({number},{to})"].needs[0].same_robot_as
    assert before == SameRobotAs("fetch({number})", "lift({number})")
    assert deliver.at == {"lift({number})": "shelf_{number}", "stow({to})": "{to}"}
    (where,) = jobs["inspect"].parameters
    assert where.choices == ("dock_1", "dock_2", "shelf_1", "shelf_2")
    assert (jobs["inspect"].priority, jobs["inspect"].deadline_us) == (0, None)


def test_the_jobs_node_has_one_subtree_for_each_of_its_types() -> None:
    mission = load()
    node = mission.tree.spec().children[1]
    assert (node.kind, node.limit) == (Kind.JOBS, 7)
    assert [(child.kind, child.name) for child in node.children] == [
        (Kind.SUBTREE, "inspect"),
        (Kind.SUBTREE, "deliver"),
    ]
    inspect, deliver = (child.children[0] for child in node.children)
    assert inspect.subject == "look({where})"
    assert (deliver.kind, deliver.limit) == (Kind.RETRY, 2)
    assert list(mission.global_tasks) == ["look(dock_1)"], "tasks that are the same in every job"
    assert mission.travel is not None
    assert mission.travel.at == {}


@pytest.mark.parametrize("body", ["all", "[deliver, inspect]", "{}", "{types: all}"])
def test_all_types_may_be_in_one_node_for_twice_as_many_jobs_as_robots(body: str) -> None:
    node = load(changed(("{types: [inspect, deliver], at_most: 7}", body))).tree.spec().children[1]
    assert [child.name for child in node.children] == ["deliver", "inspect"]
    assert node.limit == 4


def test_jobs_are_put_into_the_tree_with_all_that_they_need() -> None:
    mission = with_jobs(load(), [J2, J1])
    node = mission.tree.spec().children[1]
    assert [child.name for child in node.children] == [
        "j2: inspect(shelf_1)",
        "j1: deliver(2,dock_2)",
    ]
    ground = ["fetch(2)", "look(shelf_2)", "bring(2,dock_2)", "look(dock_1)"]
    assert subjects(node) == ["look(shelf_1)", "clear(dock_2)", *ground]
    assert {*mission.global_tasks} == {"look(shelf_1)", *ground}
    assert mission.travel is not None
    assert mission.travel.at == {"lift(2)": "shelf_2", "stow(dock_2)": "dock_2"}
    assert mission.global_tasks["bring(2,dock_2)"].effects == (("called", True),)


def test_it_is_compiled_and_part_of_the_digest() -> None:
    mission = load()
    again = mission_from_compiled(compile_mission(mission), "m.json")
    assert again == mission == pickle.loads(pickle.dumps(mission))
    assert with_jobs(again, [J1]) == with_jobs(mission, [J1])
    assert load(changed(("priority: 5", "priority: 6"))).digest != mission.digest
    reordered = GOOD.replace("jobs:\n", "jobs:\n  again: {tree: look(dock_2)}\n", 1)
    last = GOOD.replace("tree:\n  Seq", "  again: {tree: look(dock_2)}\ntree:\n  Seq", 1)
    everything = "{types: [inspect, deliver], at_most: 7}", "all"
    assert load(reordered.replace(*everything)).digest == load(last.replace(*everything)).digest


def test_a_mission_without_jobs_keeps_its_digest() -> None:
    text = GOOD[: GOOD.index("jobs:")] + "tree: look(dock_1)\n"
    assert "jobs" not in load(text).to_json()


def test_the_places_of_jobs_are_those_of_the_map_where_nobody_travels() -> None:
    text = changed(
        ("  places: {dock_1: [0, 0], dock_2: [1, 0], shelf_1: [3, 4], shelf_2: [4, 4]}\n", "")
    )
    text = text.replace("travel:\n  speed: 1\n  start: dock_1\n", "")
    text = text.replace(", at: shelf_$number", "").replace("    at: $place\n", "")
    text = text.replace(
        "number: 3}", "number: 3, map: {places: {b: {at: [0, 0]}, a: {at: [1, 1]}}}}"
    )
    assert load(text).jobs["inspect"].parameters == (JobParameter("where", ("a", "b")),)


JOBS = "- Jobs: {types: [inspect, deliver], at_most: 7}"
NODE = "Jobs: {types: [inspect, deliver], at_most: 7}"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        # Parameters.
        ("where: place", "where: places", 43, "place, or the name of a parameter that is a list"),
        ("where: place", "where: 3", 43, "place, a list, $name of a list, or {min: 1, max: 20} is"),
        ("where: place", "2nd: place", 43, "a name is expected"),
        ("to: $docks", "to: $dock", 32, "unknown parameter $dock; did you mean 'docks'?"),
        ("to: $docks", "to: $number", 32, "is expected, but $number is the number 3"),
        ("docks: [dock_1, dock_2]", "docks: []", 32, "1 to 10000 values is expected, but $docks"),
        ("to: $docks", "to: []", 32, "at least 1 expected, found 0"),
        ("to: $docks", "to: [dock_1, dock_1]", 32, "dock_1 is given twice; keep one"),
        ("to: $docks", "to: [1, '1']", 32, "1 is given twice; keep one"),
        ("to: $docks", "to: [a b]", 32, "an argument has 1 to 64 letters, digits"),
        ("to: $docks", "to: [[a]]", 32, "text, a number, true or false is expected"),
        ("min: 1, max: 2", "min: 3, max: 2", 31, "min is 3, but max is 2"),
        ("min: 1, max: 2", "min: 1", 31, "the key 'max' is missing"),
        ("min: 1, max: 2", "min: 1, max: 1e3", 31, "a whole number is expected"),
        # Usual values.
        ("priority: 5", "priority: 1001", 33, "a number of at most 1000 is expected"),
        ("priority: 5", "priority: -1", 33, "a number of at least 0 is expected"),
        ("deadline_s: 600", "deadline_s: 0", 34, "a number above 0 is expected"),
        (
            "deadline_s: 600",
            "deadline: 600",
            34,
            "unknown key 'deadline'; did you mean 'deadline_s'",
        ),
        ("attempts: 2", "attempts: 0", 35, "a number from 1, or -1 for no limit"),
        ("    attempts: 2\n", "    tries: 2\n", 35, "unknown key 'tries'"),
        # Trees of types.
        ("tree: look($where)", "tree: look($were)", 44, "unknown parameter $were; did you mean"),
        ("tree: look($where)", "tree: loop($where)", 44, "'loop' is not a declared global task"),
        ("clear($to)", "clear", 38, "condition 'clear' takes 1 argument (place), found 0"),
        (
            "tree: look($where)",
            "tree: {Sequence: {for_each: {x: $where}, do: look($x)}}",
            44,
            "for_each x: $where has one value, a job's own; for_each goes over lists",
        ),
        ("- look(dock_1)", "- look($to.$number)", 41, "joins parameters of a job in one argument"),
        (
            "to: $docks",
            f"to: [{'x' * 60}, short]",
            12,
            f"'{'x' * 60}' is not a declared place",
        ),
        ("min: 1, max: 2", "min: 1, max: 3", 9, "'shelf_3' is not a declared place; did you mean"),
        ("fetch($number), look", "look", 40, "which does not come before it in the tree"),
        ("tree: look($where)", "tree: {Jobs: [deliver]}", 44, "a node of the team's tree"),
        # The node.
        (
            "[inspect, deliver]",
            "[inspect, delivr]",
            48,
            "'delivr' is not a declared job type; did you",
        ),
        ("[inspect, deliver]", "[inspect]", 29, "no Jobs node has it; write {Jobs: [deliver]}"),
        (
            "[inspect, deliver]",
            "[deliver, inspect, deliver]",
            48,
            "deliver is in a Jobs node already",
        ),
        (JOBS, f"{JOBS}\n    - Jobs: [inspect]", 49, "inspect is in a Jobs node already"),
        ("[inspect, deliver]", "[]", 48, "at least 1 expected, found 0"),
        (
            "{types: [inspect, deliver], at_most: 7}",
            "deliverr",
            48,
            "'deliverr' is not a declared job",
        ),
        ("{types: [inspect, deliver], at_most: 7}", "deliver", 42, "write {Jobs: [inspect]} where"),
        ("  inspect:\n", "  all: {tree: look(dock_1)}\n  inspect:\n", 42, "choose another name"),
        ("{types: [inspect, deliver], at_most: 7}", "3", 48, "all, a list of job types, or {types"),
        ("at_most: 7", "at_most: 0", 48, "a number of at least 1 is expected"),
        ("at_most: 7", "at_most: 1001", 48, "a number of at most 1000 is expected"),
        ("at_most: 7", "most: 7", 48, "unknown key 'most'; did you mean 'at_most'?"),
        (
            NODE,
            f"Inverter: {{{NODE}}}",
            48,
            "jobs cannot be below Inverter (line 48); move the node",
        ),
        (NODE, f"ForceSuccess: {{{NODE}}}", 48, "jobs cannot be below ForceSuccess"),
        (
            NODE,
            f"KeepRunningUntilFailure: {{{NODE}}}",
            48,
            "cannot be below KeepRunningUntilFailure",
        ),
        (NODE, f"Repeat: {{cycles: 2, do: {{{NODE}}}}}", 48, "jobs cannot be below Repeat"),
        (
            NODE,
            f"Fallback: {{memory: while_running, children: [{{{NODE}}}]}}",
            48,
            "jobs cannot be below Fallback with memory (line 48)",
        ),
        (
            NODE,
            f"Parallel: {{for_each: {{x: [1, 2]}}, do: {{{NODE}}}}}",
            48,
            "inspect is in a Jobs node already, and its jobs can be in one only; name it once",
        ),
        (
            "ends: never\n",
            "",
            27,
            "write ends: never, or ends_mission: true for a type of jobs",
        ),
        (
            "parameters: [place]}\n  called",
            "parameters: [place], tree: {Jobs: all}}\n  called",
            15,
            "unknown key 'tree'",
        ),
    ],
)
def test_a_mistake_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    problems = problems_of(changed((old, new)))
    assert any(p.line == line and message in p.message for p in problems), problems


def test_as_many_jobs_as_there_may_be_have_room_in_the_tree() -> None:
    loop = "tree: {Sequence: {for_each: {x: [1, 2, 3, 4, 5, 6, 7, 8]}, do: look($x)}}"
    many = changed(("tree: look($where)", loop), ("at_most: 7", "at_most: 1000"))
    (problem,) = problems_of(many)
    assert problem.line == 45
    assert "has 20003 nodes, and 20000 are allowed; give its Jobs" in problem.message
    fitting = compile_mission(load(many.replace("at_most: 1000", "at_most: 999")))
    assert '"limit":999' in fitting
    with pytest.raises(FileError, match="too many nodes"):
        mission_from_compiled(fitting.replace('"limit":999', '"limit":1000'), "m.json")


def test_a_text_that_may_become_too_long_is_refused() -> None:
    long = changed(("where: place", f"where: [{'x' * 60}]"), ("look($where)", "look(shelf_$where)"))
    (problem,) = problems_of(long)
    assert problem.line == 44
    assert "but shelf_{where} becomes a text of up to 66 characters" in problem.message


def test_a_jobs_node_of_a_subtree_is_looked_at_where_it_is_used() -> None:
    inside = changed(
        ("subtrees:\n", f"subtrees:\n  work: {{tree: {{{NODE}}}}}\n"), (JOBS, "- SubTree: work")
    )
    assert load(inside).tree.containing(Kind.JOBS)[0]
    for node in ("Inverter: {SubTree: work}", "Parallel: [{SubTree: work}, {SubTree: work}]"):
        (problem,) = problems_of(inside.replace("SubTree: work", node))
        assert problem.line == 27
        assert "jobs cannot be below" in problem.message or "already" in problem.message
    (problem, *_) = problems_of(inside.replace("tree: look($where)", "tree: {SubTree: work}"))
    assert "a job's tree holds no other jobs" in problem.message


def test_a_mission_ends_with_a_job_that_ends_it() -> None:
    text = changed(("ends: never\n", ""), ("priority: 5", "ends_mission: true"))
    assert load(text).jobs["deliver"].ends_mission


def test_tasks_of_jobs_may_be_limited_by_constraints() -> None:
    limit = (
        "constraints: {not_at_once: [{global_tasks: [fetch, look(shelf_2), 'bring(1,dock_1)']}]}\n"
    )
    assert len(constraints_of(load(limit + GOOD))) == 1
    (problem,) = problems_of(limit.replace("shelf_2", "shelf_3") + GOOD)
    assert "the tree has no global task 'look(shelf_3)'" in problem.message


def test_two_needs_that_become_the_same_are_refused_with_the_job() -> None:
    text = changed(
        ("parameters: {where: place}", "parameters: {where: $docks, to: $docks}"),
        ("tree: look($where)", "tree: 'meet($where, $to)'"),
        (
            "  look: {par",
            "  meet: {parameters: [a, b], needs: {stow($a): {}, stow($b): {}}}\n  look: {par",
        ),
    )
    inspect = load(text).jobs["inspect"]
    assert inspect.problem(("dock_1", "dock_2")) == ""
    assert (
        inspect.problem(("dock_1", "dock_1")) == "meet(dock_1,dock_1) would need stow(dock_1) twice"
    )


def test_warnings_know_the_tasks_of_jobs() -> None:
    assert mission_warnings(load()) == []
    assert cautions(load()) == []
    few = changed(("lift($number): {}", "lift($number): {min: 3}"), ("stow: 1, ", ""))
    assert mission_warnings(load(few)) == [
        "fetch({number}) needs 3 robots that can do lift({number}); this mission has 2 (A1, A2)",
        "bring({number},{to}) needs 1 robots that can do stow({to}); this mission has 0 (none)",
    ]
    waits = changed(("tree: look($where)", "tree: {Fallback: [look($where), look(dock_2)]}"))
    (caution,) = cautions(load(waits))
    assert "Jobs[2]/inspect[1]/Fallback: this Fallback waits for ever" in caution
    undone = changed(("Condition: clear($to)", "Inverter: {Condition: called}"))
    assert "/deliver[2]/RetryUntilSuccessful" in cautions(load(undone))[0]
    assert "bring({number},{to}) sets called to true" in cautions(load(undone))[1]
    failed = "failed: {failure_reason: {global_task: look(%s), equals: x}}"
    for place, count in (("dock_1", 0), ("shelf_1", 0)):  # a job may ask for it
        text = changed(
            ("  called: {}\n", f"  called: {{}}\n  {failed % place}\n"),
            ("- Condition: called", "- Inverter: {Condition: failed}"),
        )
        assert len(cautions(load(text))) == count
    text = text.replace("global_task: look(shelf_1)", "local_task: spare")
    assert len(cautions(load(text.replace("  call: {", "  spare: {}\n  call: {")))) == 1


def test_a_jobs_node_is_written_as_it_is_read() -> None:
    written = json.dumps({"tree": tree_data(load().tree.spec())})
    text = GOOD[: GOOD.index("tree:\n  Sequence:\n    - Condition: called")]
    assert load(text + written[1:-1].replace('"tree"', "tree", 1) + "\n") == load()


def test_a_tree_in_a_file_gets_the_values_of_the_job(tmp_path: Path) -> None:
    tree = '<BehaviorTree ID="T"><Place to="{to}"/></BehaviorTree>'
    (tmp_path / "t.xml").write_text(f'<root BTCPP_format="4">{tree}</root>')
    text = changed(
        (
            "    at: $place\n",
            "    at: $place\n    tree: t.xml#T\n    ports: {to: here-$place, n: 2}\n"
            "    outputs: {done: clear($place)}\n",
        ),
    )
    mission = load(text, tmp_path)
    assert not mission.program_trees
    assert mission_from_compiled(compile_mission(mission), "m.json") == mission
    ground = with_jobs(mission, [J1]).program_trees
    assert list(ground) == ["stow(dock_2)"]
    assert ground["stow(dock_2)"].ports == (("n", "2"), ("to", "here-dock_2"))
    assert ground["stow(dock_2)"].outputs == (("done", "clear(dock_2)"),)


# -- compiled missions that were damaged --------------------------------------------------------


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("jobs['in spect'] = jobs.pop('inspect')", "job type in spect"),
        ("jobs['other'] = jobs.pop('deliver')", "each job type is in one Jobs node"),
        ("jobs['deliver'] = None", "jobs.deliver: an object expected"),
        ("parameters[0]['name'] = 'number of'", "parameter 'number of'"),
        ("parameters[1]['name'] = 'number'", "parameters"),
        ("parameters[1]['choices'][0] = 'a b'", "choices"),
        ("parameters[1]['choices'][0] = 'dock_2'", "choices"),
        ("parameters[1]['choices'][0] = 3", "parameters.1.choices.0: a text expected"),
        ("parameters[1]['choices'][0] = 'dock_3'", "places"),
        ("parameters[0]['low'] = 3", "numbers"),
        ("parameters[0]['high'] = 1.5", "parameters.0.high: a whole number expected"),
        ("parameters[0]['high'] = 10**10", "numbers"),
        ("deliver['priority'] = -1", "priority"),
        ("deliver['deadline_us'] = 0", "deliver: deadline"),
        ("deliver['ends_mission'] = 1", "ends_mission: true or false expected"),
        ("tasks[0]['id'] = 'fetch(2)'", "ground names"),
        ("tasks[0]['id'] = 'fetch({nr})'", ""),
        ("tasks[0]['needs'][0]['local_task'] = 'lift({nr})'", ""),
        ("tasks[0]['needs'][0]['min_robots'] = 0", "no robot is needed"),
        (
            "tasks[2]['needs'][0]['same_robot_as']['global_task'] = 'look({number})'",
            "same_robot_as",
        ),
        ("deliver['at']['stow(dock_1)'] = 'dock_1'", "ground names"),
        ("deliver['at']['stow({to})'] = 'shelf_{to}'", "places"),
        (
            "deliver['program_trees'] = {'trees': {'stow({to})': [0, 'T', [], []]}}",
            "tree of stow({to}): file 0",
        ),
        ("d['ends'] = 'once'", "never ends"),
        ("open_jobs['limit'] = 0", ""),
        ("open_jobs['limit'] = 1001", "jobs at a time"),
        ("open_jobs['children'][0]['kind'] = 'ForceSuccess'", "children of Jobs"),
        ("open_jobs['children'][0]['name'] = 'deliver'", "each job type is in one Jobs node"),
        ("d['tree']['memory'] = 'while_running'", "above Jobs"),
        ("open_jobs['children'][0]['children'][0]['subject'] = 'look({here})'", ""),
        ("open_jobs['children'][0]['children'] = [{'kind': 'Jobs', 'limit': 1}]", "of Jobs"),
        ("d['jobs'] = {}", "each job type is in one Jobs node"),
    ],
)
def test_a_damaged_compiled_mission_is_refused(damage: str, message: str) -> None:
    data = json.loads(compile_mission(load()))
    deliver = data["jobs"]["deliver"]
    names = {
        "d": data,
        "jobs": data["jobs"],
        "deliver": deliver,
        "parameters": deliver["parameters"],
        "tasks": deliver["global_tasks"],
        "open_jobs": data["tree"]["children"][1],
    }
    exec(damage, names)
    with pytest.raises(FileError) as caught:
        mission_from_compiled(json.dumps(data), "m.json")
    (problem,) = caught.value.problems
    assert message in problem.message
    assert problem.message.endswith("compile the mission again")


# -- a job is what its tree with values in place of its parameters would be ---------------------

HEAD: dict[str, Any] = {
    "mission": "m",
    "travel": {
        "places": {"p_1": [0, 0], "p_2": [1, 0], "p_12": [2, 2]},
        "speed": 1,
        "start": "p_1",
    },
    "local_tasks": {
        "weld": {"parameters": ["part"], "at": "p_$part", "effects": {"hot($part)": True}},
        "hold": {"parameters": ["a", "b"]},
    },
    "conditions": {"hot": {"parameters": ["part"]}, "cold": {}},
    "robot_types": {"A": {"capabilities": {"weld": 1, "hold": 1}}},
    "robots": {"A1": "A"},
    "global_tasks": {
        "fix": {"parameters": ["part"], "needs": {"weld($part)": {}}},
        "bind": {"parameters": ["a", "b"], "needs": {"weld($a)": {}, "weld($b)": {}}},
        "turn": {
            "parameters": ["a", "b"],
            "needs": {"hold($a, -$b)": {}, "weld(12)": {"min": 0, "max": 1}},
        },
    },
    "subtrees": {
        "mend": {
            "parameters": ["x"],
            "tree": {"Parallel": {"for_each": {"a": [1, 2]}, "do": "turn($a, $x)"}},
        }
    },
}
VALUES = st.sampled_from(["$a", "$n", "1", "12"])


def calls(name: str, count: int) -> st.SearchStrategy[str]:
    return st.tuples(*[VALUES] * count).map(lambda values: f"{name}({', '.join(values)})")


def named(kind: str, children: list[Any], title: str | None) -> Any:
    return {kind: children if title is None else {"name": title, "children": children}}


TREES = st.recursive(
    calls("fix", 1)
    | calls("bind", 2)
    | calls("turn", 2)
    | calls("hot", 1).map(lambda call: {"Condition": call})
    | calls("mend", 1).map(lambda call: {"SubTree": call}),
    lambda inner: (
        st.builds(
            named,
            st.sampled_from(["Sequence", "Fallback", "Parallel"]),
            st.lists(inner, min_size=1, max_size=3),
            st.sampled_from([None, "part $a of $n"]),
        )
        | inner.map(lambda node: {"Inverter": node})
        | inner.map(lambda node: {"Timeout": {"seconds": 5, "do": node}})
        | inner.map(lambda node: {"Sequence": {"for_each": {"n": [1, 2]}, "do": [node, "fix($n)"]}})
    ),
    max_leaves=8,
)


def plain(spec: NodeSpec) -> NodeSpec:
    """Without the places where its nodes come from."""
    return replace(spec, children=tuple(map(plain, spec.children)), origin=-1, job="")


def loaded(data: dict[str, Any]) -> Mission | None:
    """The mission, by way of its compiled form; None if a task needs something twice."""
    try:
        mission = load(json.dumps(data))
    except FileError as error:
        if all("twice; keep one" in each.message for each in error.problems):
            return None
        raise
    return mission_from_compiled(compile_mission(mission), "m.json")


@given(TREES, st.sampled_from(["1", "2", "12"]), st.integers(1, 2))
def test_a_job_is_its_tree_with_the_values(tree: Any, a: str, n: int) -> None:
    kind = {"parameters": {"a": [1, 2, 12], "n": {"min": 1, "max": 2}}, "tree": tree}
    declared = {**HEAD, "ends": "never", "jobs": {"job": kind}, "tree": {"Jobs": "all"}}
    direct = {**HEAD, "parameters": {"a": a, "n": n}, "tree": tree}
    mission, expected = loaded(declared), loaded(direct)
    if mission is None or mission.jobs["job"].problem((a, str(n))):
        assert expected is None
        return
    assert expected is not None
    found = with_jobs(mission, [OpenJob("j", "job", (a, str(n)))])
    (job,) = found.tree.spec().children
    assert plain(job.children[0]) == plain(expected.tree.spec())
    assert {node.job for node in found.tree.nodes} == {"", "j"}
    assert found.global_tasks == expected.global_tasks
    places = [each.travel.at if each.travel else {} for each in (found, expected)]
    assert places[0] == places[1]
