"""Loading missions: the examples, the ground facts in them, and the compiled form."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from textwrap import dedent

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Kind, Memory
from mrbt_mesh.core.mission.compiled import mission_from_compiled
from mrbt_mesh.core.mission.mission import (
    MICRO,
    FailurePolicy,
    Mission,
    Need,
    mission_from_json,
    performance,
)
from mrbt_mesh.features.bids.needs import BidRule, has_bids
from mrbt_mesh.formats.build import mission_from_yaml, resolve_program
from mrbt_mesh.formats.mission_file import (
    FileError,
    compile_mission,
    load_mission,
    mission_warnings,
)
from tests.support.paths import ROOT

EXAMPLES = sorted(ROOT.glob("examples/*/mission.yaml"))

SMALL = """
mission: small
local_tasks: {weld: {parameters: [part], work: 2}, paint: {}}
conditions: {dry: {default: true}}
robot_types: {A: {capabilities: {weld: 1.5, "weld(3)": 0.25}}}
robots: {A1: A}
global_tasks:
  fix: {parameters: [part], needs: {weld($part): {}}}
tree: fix(3)
"""


def load_text(text: str) -> Mission:
    return mission_from_yaml(dedent(text), "m.yaml", Path("/nowhere"))


def test_bids_are_read() -> None:
    declared = load_text(SMALL)
    assert not has_bids(declared)
    assert load_text(
        SMALL.replace("{weld($part): {}}", "{weld($part): {performance: declared}}")
    ) == (declared)
    for text, within_us in (("bid", None), ("{bid_within_s: 1.5}", 1_500_000)):
        mission = load_text(SMALL.replace("{}}}\ntree", f"{{performance: {text}}}}}}}\ntree"))
        (need,) = mission.global_tasks["fix(3)"].needs
        assert need == Need("weld(3)", 1, 1, performance_rule=BidRule(within_us))
        assert mission_from_compiled(compile_mission(mission), "m.json") == mission
        assert mission.digest != declared.digest


def example(name: str) -> Mission:
    return load_mission(ROOT / "examples" / name / "mission.yaml")


def test_the_examples_are_where_the_readme_says() -> None:
    names = [path.parent.name for path in EXAMPLES]
    assert names == [
        "assembly",
        "couriers",
        "deliveries",
        "depot",
        "dispense",
        "explore",
        "inspection",
        "lift",
        "tool_search",
        "vehicle_repair",
        "warehouse",
        "workshop",
    ]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_examples_load_without_warnings_and_name_an_existing_program(path: Path) -> None:
    mission = load_mission(path)
    assert mission.name == path.parent.name
    assert mission_warnings(mission) == []
    assert mission.program is not None
    assert Path(mission.program).is_absolute()
    assert Path(mission.program).is_file()


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_compiling_an_example_changes_nothing(path: Path, tmp_path: Path) -> None:
    mission = load_mission(path)
    compiled = tmp_path / "mission.json"
    compiled.write_text(compile_mission(mission))
    again = load_mission(compiled)
    assert again == mission
    assert again.digest == mission.digest
    # Not sorted here: the order of robots and tasks has to survive as well.
    assert json.dumps(again.to_json()) == json.dumps(mission.to_json())


def test_vehicle_repair_has_the_robots_of_the_paper() -> None:
    mission = example("vehicle_repair")
    assert list(mission.robots) == ["A1", "A2", "B1", "B2", "C1", "C2"]
    assert sum(len(robot.capabilities) for robot in mission.robots.values()) == 18
    table = {  # The paper's table of performance values.
        "use_screwdriver": (None, None, 1),
        "move_frame": (None, None, 1),
        "do_diagnosis(4)": (3, 1, None),
        "replace_hw(4)": (1.5, 1, None),
        "replace_wires(4)": (1.5, 1, None),
        "use_soldering_iron(4)": (None, 1, None),
    }
    for task, row in table.items():
        for kind, value in zip("ABC", row, strict=True):
            for number in "12":
                expected = None if value is None else int(value * MICRO)
                capabilities = mission.robots[kind + number].capabilities
                assert performance(capabilities, task) == expected, (task, kind)


def test_vehicle_repair_has_the_bounds_of_the_paper() -> None:
    mission = example("vehicle_repair")
    bounds = {
        (task.id, need.local_task): (need.min_robots, need.max_robots)
        for task in mission.global_tasks.values()
        for need in task.needs
    }
    expected = {
        ("remove_screws", "use_screwdriver"): (1, 2),
        ("place_screws", "use_screwdriver"): (1, 2),
        ("remove_cover", "move_frame"): (2, 2),
        ("place_cover", "move_frame"): (2, 2),
    }
    for k in range(1, 6):
        expected[f"diagnose_part({k})", f"do_diagnosis({k})"] = (1, 1)
        expected[f"fix_hw({k})", f"replace_hw({k})"] = (1, 1)
        expected[f"fix_wires({k})", f"replace_wires({k})"] = (1, 2)
        expected[f"solder({k})", f"use_soldering_iron({k})"] = (1, 3)
    assert bounds == expected


def test_vehicle_repair_has_the_tree_of_the_paper() -> None:
    mission = example("vehicle_repair")
    tree = mission.tree
    assert [node.subject for node in tree.actions()] == [
        "remove_screws",
        "remove_cover",
        *(f"diagnose_part({k})" for k in range(1, 6)),
        *(f"{task}({k})" for k in range(1, 6) for task in ("fix_hw", "fix_wires", "solder")),
        "place_cover",
        "place_screws",
    ]
    assert list(mission.global_tasks) == [node.subject for node in tree.actions()]
    assert tree.nodes[1].subject == "nominal"
    subtrees = [node.label for node in tree.nodes if node.kind is Kind.SUBTREE]
    assert subtrees == [f"fix_part({k})" for k in range(1, 6)]
    parallels = [node for node in tree.nodes if node.kind is Kind.PARALLEL]
    assert [(node.name, node.limit) for node in parallels] == [("diagnose", 5), ("fix", 5)]
    inverted = [n for n in tree.nodes if n.kind is Kind.INVERTER]
    assert [tree.nodes[n.children[0]].subject for n in inverted] == [
        f"broken({k})" for k in range(1, 6)
    ]
    assert not mission.entries.default("nominal")
    assert mission.parameters["broken_parts"] == [2, 4]


def test_vehicle_repair_without_faults_takes_20_to_30_seconds() -> None:
    mission = example("vehicle_repair")

    def seconds(robot: str, task: str) -> float:
        rate = performance(mission.robots[robot].capabilities, task)
        assert rate is not None
        return mission.local_tasks[task].work / rate

    # The second diagnosis of an A comes before the first of a B: B robots are the bottleneck.
    assert 2 * seconds("A1", "do_diagnosis") < seconds("B1", "do_diagnosis")
    fastest_wires, slowest_wires = seconds("A1", "replace_wires"), seconds("B1", "replace_wires")
    fixed = (
        2 * seconds("C1", "use_screwdriver")
        + 2 * seconds("C1", "move_frame")
        + seconds("B1", "do_diagnosis")
        + seconds("A1", "replace_hw")
        + seconds("B1", "use_soldering_iron")
    )
    assert fixed + fastest_wires > 20
    # Agreement before each of the nine phases takes time as well.
    assert fixed + slowest_wires < 27


def test_explore_gives_each_robot_both_areas() -> None:
    mission = example("explore")
    assert list(mission.global_tasks) == ["explore_area(A)", "explore_area(B)"]
    assert mission.tree.nodes[0].limit == 2
    assert [set(robot.capabilities) for robot in mission.robots.values()] == [{"explore"}] * 2


def test_tool_search_searches_in_parallel_and_tightens_in_order() -> None:
    mission = example("tool_search")
    root = mission.tree.nodes[0]
    search, tighten = (mission.tree.nodes[child] for child in root.children)
    assert (search.kind, search.limit, len(search.children)) == (Kind.PARALLEL, 1, 2)
    assert tighten.kind is Kind.FALLBACK
    subjects = [mission.tree.nodes[child].subject for child in tighten.children]
    assert subjects == ["tighten_with_large", "tighten_with_small"]
    assert mission.parameters["large_fits"] is False
    assert {t.failure for t in mission.global_tasks.values()} == {FailurePolicy.PAPER}


def test_a_capability_for_one_ground_task_goes_before_its_type() -> None:
    capabilities = load_text(SMALL).robots["A1"].capabilities
    assert capabilities == {"weld": 1_500_000, "weld(3)": 250_000}
    assert performance(capabilities, "weld(3)") == 250_000
    assert performance(capabilities, "weld(2)") == 1_500_000


def test_a_robot_may_differ_from_its_type() -> None:
    own = "{type: A, capabilities: {weld: null, paint: 2}}"
    mission = load_text(SMALL.replace("A1: A", f"A1: {own}, A2: A"))
    assert mission.robots["A1"].capabilities == {"weld(3)": 250_000, "paint": 2_000_000}
    assert mission.robots["A2"].capabilities == mission.robot_types["A"]


def test_policies_of_a_global_task() -> None:
    text = SMALL.replace(
        "weld($part): {}}",
        "weld($part): {min: 2, max: 3}}, failure: paper, blocked: {fail_after_s: 0.5}, "
        "preemptive: true",
    )
    (task,) = load_text(text).global_tasks.values()
    assert (task.needs[0].min_robots, task.needs[0].max_robots) == (2, 3)
    assert task.failure is FailurePolicy.PAPER
    assert task.blocked_fail_after_us == 500_000
    assert task.preemptive


def test_defaults_of_a_global_task() -> None:
    text = SMALL.replace("weld($part): {}", "weld($part): {min: 3}")
    (task,) = load_text(text).global_tasks.values()
    assert (task.needs[0].min_robots, task.needs[0].max_robots) == (3, 3)
    assert task.failure is FailurePolicy.RESILIENT
    assert task.failure_after_us is None
    assert task.blocked_fail_after_us is None
    assert not task.preemptive


def test_warnings_name_what_the_team_can_never_do() -> None:
    text = SMALL.replace("A1: A", "A1: A, Z: {type: A, capabilities: {weld: null, weld(3): null}}")
    assert mission_warnings(load_text(text)) == ["robot Z can do nothing that the tree asks for"]
    text = SMALL.replace("weld($part): {}", "weld($part): {min: 2}")
    (warning,) = mission_warnings(load_text(text))
    assert warning == "fix(3) needs 2 robots that can do weld(3); this mission has 1 (A1)"
    text = SMALL.replace("weld($part): {}", "paint: {}")
    assert "has 0 (none)" in mission_warnings(load_text(text))[0]


def test_the_program_is_relative_to_the_mission_file(tmp_path: Path) -> None:
    folder = tmp_path / "missions"
    folder.mkdir()
    (folder / "m.yml").write_text("program: ../robots/r.py:mine\n" + SMALL)
    mission = load_mission(folder / "m.yml")
    assert mission.program == f"{tmp_path.resolve()}/robots/r.py:mine"
    (tmp_path / "m.json").write_text(compile_mission(mission))
    assert load_mission(tmp_path / "m.json").program == mission.program
    relative = replace(mission, program="robots/r.py:mine")
    (tmp_path / "m.json").write_text(compile_mission(relative))
    assert load_mission(tmp_path / "m.json").program == mission.program


def test_programs_with_and_without_a_name() -> None:
    assert resolve_program(None, Path("/a")) is None
    assert resolve_program("r.py", Path("/a")) == "/a/r.py"
    assert resolve_program("r.py:x", Path("/a")) == "/a/r.py:x"
    assert resolve_program("/b:c/r.py", Path("/a")) == "/b:c/r.py"


def test_the_program_is_no_part_of_the_digest() -> None:
    assert load_text("program: r.py\n" + SMALL).digest == load_text(SMALL).digest


def test_the_order_of_the_file_does_not_matter_to_robots() -> None:
    one = SMALL.replace("{A1: A}", "{A1: A, A2: A}")
    other = SMALL.replace("{A1: A}", "{A2: A, A1: A}")
    assert json.dumps(load_text(one).to_json()) == json.dumps(load_text(other).to_json())


def test_loading_a_compiled_mission_imports_neither_pydantic_nor_yaml(tmp_path: Path) -> None:
    compiled = tmp_path / "mission.json"
    compiled.write_text(compile_mission(example("vehicle_repair")))
    code = """
        import sys
        from pathlib import Path
        from mrbt_mesh.formats.mission_file import load_mission
        mission = load_mission(Path(sys.argv[1]))
        heavy = [name for name in sys.modules if name.split(".")[0] in ("pydantic", "ruamel")]
        print(mission.name, heavy)
    """
    done = subprocess.run(
        [sys.executable, "-c", dedent(code), str(compiled)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "vehicle_repair []"


def _damaged(change: str) -> str:
    """The compiled small mission after executing `change` on its data `d`."""
    data = json.loads(compile_mission(load_text(SMALL)))
    exec(change, {"d": data})
    return json.dumps(data)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("d['compiled'] = 99", "version 4 expected, found 99"),
        ("d.pop('compiled')", "not a compiled mission"),
        ("d.pop('tree')", "damaged: 'tree' is missing"),
        ("d['name'] = 3", "name: a text expected, not 3"),
        ("d['program'] = 3", "program: a text or null expected, not 3"),
        ("d['parameters'] = []", "parameters: an object expected, not []"),
        ("d['robots'] = {}", "0 robots"),
        ("d['robots'] = 3", "robots: an object expected, not 3"),
        ("d['robots']['../x'] = d['robots']['A1']", "robot id '../x'"),
        ("d['robots']['A1']['id'] = 'A1'", "robots.A1: id is given twice"),
        ("d['robots']['A1']['type'] = 'B'", "type 'B'"),
        ("d['robots']['A1']['capabilities']['weld'] = -1", "performance -1"),
        (
            "d['robots']['A1']['capabilities']['weld'] = True",
            "robots.A1.capabilities.weld: a whole number expected, not True",
        ),
        ("d['robots']['A1']['capabilities']['x'] = 1", "unknown capability 'x'"),
        ("d['robot_types']['A']['weld'] = 1.5", "robot_types.A.weld: a whole number expected"),
        ("d['local_tasks']['weld']['work'] = 0", "work"),
        ("d['local_tasks']['weld']['parameters'] = ['a', 1]", "weld.parameters.1: a text expected"),
        ("d['conditions']['dry']['default'] = 'no'", "condition dry"),
        ("d['conditions']['dry']['default'] = 1", "condition dry"),
        ("d['global_tasks'] *= 2", "global_tasks: a key is given twice"),
        ("d['global_tasks'][0]['needs'][0]['local_task'] = 'weld'", "local task 'weld'"),
        ("d['global_tasks'][0]['needs'][0]['min_robots'] = 2", "bounds of weld(3)"),
        ("d['global_tasks'][0]['needs'][0]['min_robots'] = -1", "bounds of weld(3)"),
        ("d['global_tasks'][0]['needs'][0]['min_robots'] = 0", "no robot is needed"),
        (
            "d['global_tasks'][0]['needs'][0]['after'] = ''",
            "global_tasks.0.needs.0.after: nothing of this name (only local_task, ",
        ),
        (
            "d['global_tasks'][0]['failure'] = 'never'",
            "failure: paper or first or resilient expected, not 'never'",
        ),
        ("d['global_tasks'][0]['blocked_fail_after_us'] = 0", "blocked"),
        ("d['global_tasks'][0]['failure_after_us'] = 0", "failure"),
        ("d['global_tasks'][0]['effects'] = [['dry']]", "effects.0: a list of 2 expected"),
        ("d['global_tasks'][0]['effects'] = [['wet', True]]", "effect on 'wet'"),
        ("d['global_tasks'][0]['preemptive'] = 0", "preemptive: true or false expected, not 0"),
        (
            "d['global_tasks'][0]['joint'] = {'CoalitionPolicy': {'begin_within_us': 5}}",
            "global task fix(3): coalitions",
        ),
        (
            "d['global_tasks'][0]['joint'] = {'CoalitionPolicy': {'exclusive': 1}}",
            "joint.CoalitionPolicy.exclusive: true or false expected",
        ),
        (
            "d['global_tasks'][0]['joint'] = {'BidRule': {}}",
            "joint: an object with CoalitionPolicy expected",
        ),
        ("d['tree']['subject'] = 'other'", "tree node 0: 'other'"),
        ("d['tree']['kind'] = 'Condition'", "tree node 0: 'fix(3)'"),
        ("d['tree']['kind'] = 'Sequence'", "needs at least one child"),
        ("d['tree']['timeout_us'] = 0.5", "tree.timeout_us: a whole number expected"),
        ("d['tree']['number'] = 1", "tree.number: nothing of this name (only kind, "),
        ("d['tree'] = []", "tree: an object expected, not []"),
        ("d['parameters'] = {'x': float('inf')}", "not JSON compliant"),
        (
            "d['sections'] = {'assignment': 'spare_scarce'}",
            "sections.assignment: nothing of this name expected",
        ),
    ],
)
def test_a_damaged_compiled_mission_is_refused(change: str, message: str) -> None:
    with pytest.raises(FileError) as caught:
        mission_from_compiled(_damaged(change), "m.json")
    assert message in str(caught.value)
    assert str(caught.value).startswith("m.json: ")


def test_broken_json_names_the_line() -> None:
    with pytest.raises(FileError, match=r"^m\.json:2: not valid JSON"):
        mission_from_compiled('{"compiled": 1,\n oops}', "m.json")
    with pytest.raises(FileError, match="not a compiled mission"):
        mission_from_compiled("[]", "m.json")
    with pytest.raises(FileError, match=r"nested too deep|not valid JSON"):
        mission_from_compiled("[" * 100_000 + "]" * 100_000, "m.json")


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)


@given(st.data(), json_values)
def test_no_damage_to_a_compiled_mission_raises_anything_else(
    data: st.DataObject, value: object
) -> None:
    """I8 for files: put any value at any place."""
    compiled = json.loads(compile_mission(load_text(SMALL)))
    place = compiled
    key = data.draw(st.sampled_from(sorted(place)))
    while isinstance(place[key], dict | list) and place[key] and data.draw(st.booleans()):
        place = place[key]
        key = data.draw(
            st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place)))
        )
    place[key] = value
    try:
        mission = mission_from_compiled(json.dumps(compiled), "m.json")
    except FileError:
        return
    assert mission_from_compiled(compile_mission(mission), "m.json").digest == mission.digest


def test_nodes_with_memory_and_parallels_that_fail_early() -> None:
    tree = (
        "{Sequence: {memory: while_running, children: [fix(3), {IfThenElse: [fix(3), fix(3)]}, "
        "{Parallel: {success: any, failures: 1, children: [fix(3), fix(3)]}}]}}"
    )
    text = "\n".join(
        f"tree: {tree}" if line.startswith("tree:") else line for line in SMALL.splitlines()
    )
    mission = load_text(text)
    nodes = mission.tree.nodes
    assert nodes[0].memory is Memory.WHILE_RUNNING
    assert [nodes[index].kind for index in nodes[0].children][1:] == [
        Kind.IF_THEN_ELSE,
        Kind.PARALLEL,
    ]
    parallel = nodes[nodes[0].children[2]]
    assert (parallel.limit, parallel.failures) == (1, 1)
    assert mission_from_json(mission.to_json()).tree == mission.tree
    with pytest.raises(FileError, match="failures: 3 is more than the 2 children"):
        load_text(text.replace("failures: 1", "failures: 3"))


def test_a_solver_is_named_but_is_no_part_of_the_digest() -> None:
    plain, named = load_text(SMALL), load_text("solver: my.solvers:best\n" + SMALL)
    assert (plain.solver, named.solver) == (None, "my.solvers:best")
    assert named.digest == plain.digest
    assert mission_from_json(json.loads(compile_mission(named))).solver == named.solver
    assert "solver" not in json.loads(compile_mission(plain))


@pytest.mark.parametrize("text", ["", "a b", "x:y:z", "../evil", "3"])
def test_a_solver_that_could_be_no_name_is_refused(text: str) -> None:
    with pytest.raises(FileError, match=r"solver: (the name of a solver|text|a text|Input)"):
        load_text(f"solver: {text!r}\n" + SMALL)
