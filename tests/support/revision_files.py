"""Random mission files with types of jobs, and random changes of them, as plain data."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable
from typing import Any, TypeAlias

import yaml

File: TypeAlias = dict[str, Any]
CONDITIONS = ("c0", "c1")


def text_of(file: File, pick: random.Random) -> str:
    """A file as YAML, with the entries of its maps in any order."""
    return yaml.safe_dump(_shuffled(file, pick), sort_keys=False, default_flow_style=False)


def _shuffled(data: Any, pick: random.Random) -> Any:
    if isinstance(data, list):
        return [_shuffled(each, pick) for each in data]
    if not isinstance(data, dict):
        return data
    names = list(data)
    # The parameters of a type are positions of a job's arguments.
    if all(isinstance(data[name], dict | str | int | float) for name in names):
        pick.shuffle(names)
    return {
        name: data[name] if name == "parameters" else _shuffled(data[name], pick) for name in names
    }


def random_file(pick: random.Random) -> File:
    """Three to five robots of two types, four tasks, one to three types of jobs, and a tree."""
    has_places = pick.random() < 0.4
    robots = {f"R{n}": pick.choice(["arm", "eye"]) for n in range(1, pick.randint(4, 6))}
    robots |= {"R1": "arm", "R2": "eye"}
    file: File = {
        "mission": "revised",
        "ends": "never",
        "local_tasks": {
            name: {"parameters": ["p"], "work": pick.choice([1, 2, 4])}
            for name in ("la", "lb", "lc", "ld")
        },
        "robot_types": {
            "arm": {"capabilities": {"la": 1, "lb": 1, "lc": 1}},
            "eye": {"capabilities": {"lb": 1, "lc": 1, "ld": 1}},
        },
        "robots": robots,
        "conditions": {name: {"default": True} for name in CONDITIONS},
        "global_tasks": {
            f"t{letter}": {"parameters": ["p"], "needs": {f"l{letter}($p)": {"min": 1}}}
            for letter in "abcd"
        },
    }
    for task in pick.sample(sorted(file["global_tasks"]), pick.randint(0, 2)):
        file["global_tasks"][task]["exclusive"] = True
    if has_places:
        file["travel"] = {
            "places": {f"p{n}": [n, pick.randint(0, 2)] for n in range(4)},
            "speed": 2,
            "start": dict.fromkeys(robots, "p0"),
        }
        file["local_tasks"]["lc"]["at"] = "$p"
        if pick.random() < 0.5:
            file["local_tasks"]["ld"]["at"] = "p1"
    file["jobs"] = {f"j{n}": _random_type(pick, has_places) for n in range(pick.randint(1, 3))}
    jobs = {"Jobs": {"types": sorted(file["jobs"]), "at_most": 8}}
    main = _random_tree(pick, ["ta(p1)", "tb(p2)", "tc(p1)", "td(p3)"], 2)
    file["tree"] = {"Parallel": {"success": "all", "children": [main, jobs]}}
    return file


def _random_type(pick: random.Random, has_places: bool) -> File:
    values: Any = "place" if has_places else ["p1", "p2", "p3"]
    leaves = [f"t{letter}($p)" for letter in "abcd"]
    return {"parameters": {"p": values}, "tree": _random_tree(pick, leaves, 4)}


def _random_tree(pick: random.Random, leaves: list[str], most: int) -> Any:
    """Each leaf once at most; all must succeed."""
    chosen = pick.sample(leaves, pick.randint(min(2, most - 1), most))
    steps = [_wrapped(pick, leaf) for leaf in chosen]
    if len(steps) == 1:
        return steps[0]
    kind = pick.random()
    if kind < 0.3:
        return {"Parallel": {"success": "all", "children": steps}}
    if kind < 0.45:
        return {"Sequence": {"memory": "while_running", "children": steps}}
    return {"Sequence": steps}


def _wrapped(pick: random.Random, leaf: Any) -> Any:
    kind = pick.random()
    if kind < 0.2:
        return {"RetryUntilSuccessful": {"attempts": pick.randint(2, 4), "do": leaf}}
    if kind < 0.35:
        return {"Sequence": [{"Condition": pick.choice(CONDITIONS)}, leaf]}
    if kind < 0.45:
        return {"ForceSuccess": leaf}
    return leaf


# -- changes --------------------------------------------------------------------------------------


def changed(file: File, pick: random.Random) -> File:
    """One to three changes of it."""
    found = copy.deepcopy(file)
    for _ in range(pick.randint(1, 3)):
        pick.choice(CHANGES)(found, pick)
    return found


def guarded(file: File, pick: random.Random) -> File:
    """Every tree behind a condition that holds: all its steps are others."""
    found = copy.deepcopy(file)
    for holder, key, _ in _trees(found):
        holder[key] = {"Sequence": [{"Condition": pick.choice(CONDITIONS)}, holder[key]]}
    return found


def _trees(file: File) -> list[tuple[Any, Any, bool]]:
    """Where trees are: what has each, under which key, and whether it is that of a type."""
    found: list[tuple[Any, Any, bool]] = [(file["tree"]["Parallel"]["children"], 0, False)]
    return found + [(kind, "tree", True) for kind in file["jobs"].values()]


def _other_values(file: File, pick: random.Random) -> None:
    for kind in file["jobs"].values():
        values = kind["parameters"][next(iter(kind["parameters"]))]
        if isinstance(values, list):
            change = pick.random()
            if change < 0.5:
                values.append(f"q{len(values)}")
            elif change < 0.6 and len(values) > 1:
                values.remove(pick.choice(values))
            pick.shuffle(values)


def _other_places(file: File, pick: random.Random) -> None:
    if "travel" not in file:
        return
    places = file["travel"]["places"]
    if pick.random() < 0.6:
        places[f"q{len(places)}"] = [len(places), 1]
    elif len(places) > 2 and pick.random() < 0.5:
        for name in pick.sample(sorted(places.keys() - {"p0", "p1"}), 1):
            del places[name]
    else:
        places["p2"] = [pick.randint(-2, 4), 1]


def _other_name_of_parameter(file: File, pick: random.Random) -> None:
    kind = file["jobs"][pick.choice(sorted(file["jobs"]))]
    (old, values), new = next(iter(kind["parameters"].items())), pick.choice(["p", "bed", "q"])
    kind["parameters"] = {new: values}
    kind["tree"] = _replaced(kind["tree"], f"${old})", f"${new})")


def _replaced(data: Any, old: str, new: str) -> Any:
    if isinstance(data, str):
        return data.replace(old, new)
    if isinstance(data, list):
        return [_replaced(each, old, new) for each in data]
    if isinstance(data, dict):
        return {key: _replaced(value, old, new) for key, value in data.items()}
    return data


def _other_tree(file: File, pick: random.Random) -> None:
    """Steps in another order, one less, something around it, or a tree with all anew."""
    holder, key, is_type = pick.choice(_trees(file))
    tree = holder[key]
    steps = tree.get("Sequence") if isinstance(tree, dict) else None
    change = pick.random()
    if isinstance(steps, list) and change < 0.25:
        pick.shuffle(steps)
    elif isinstance(steps, list) and len(steps) > 1 and change < 0.4:
        steps.remove(pick.choice(steps))
    elif change < 0.55:
        holder[key] = {"ForceSuccess": tree}
    elif change < 0.85:
        holder[key] = {"Sequence": [{"Condition": pick.choice(CONDITIONS)}, tree]}
    elif is_type:
        parameter = next(iter(holder["parameters"]))
        leaves = [f"t{letter}(${parameter})" for letter in "abcd"]
        holder[key] = _random_tree(pick, leaves, 4)


def _other_attempts(file: File, pick: random.Random) -> None:
    def visit(data: Any) -> None:
        if isinstance(data, list):
            for each in data:
                visit(each)
        elif isinstance(data, dict):
            for name, value in data.items():
                if name == "RetryUntilSuccessful":
                    value["attempts"] = pick.randint(1, 5)
                visit(value)

    visit(file["tree"])
    visit(file["jobs"])


def _other_task(file: File, pick: random.Random) -> None:
    task = file["global_tasks"][pick.choice(sorted(file["global_tasks"]))]
    (need,) = task["needs"].values()
    change = pick.random()
    if change < 0.5:
        need["max"] = need.get("max", 1) % 3 + 1
    elif change < 0.65:
        policy = pick.choice(["simultaneous", "preemptive"])
        task[policy] = not task.get(policy, False)
    elif change < 0.8:
        task["failure"] = "paper" if task.get("failure") != "paper" else "resilient"
    else:
        task["exclusive"] = not task.get("exclusive", False)


def _other_robots(file: File, pick: random.Random) -> None:
    """More work, a better robot, or one robot more."""
    change = pick.random()
    if change < 0.4:
        file["local_tasks"][pick.choice(["la", "lb", "ld"])]["work"] = pick.choice([1, 2, 5])
    elif change < 0.7:
        able = file["robot_types"][pick.choice(["arm", "eye"])]["capabilities"]
        able["lb"] = pick.choice([1, 2])
    elif len(file["robots"]) < 7:
        name = f"N{len(file['robots'])}"
        file["robots"][name] = "arm"
        if "travel" in file:
            file["travel"]["start"][name] = "p0"


def _other_types(file: File, pick: random.Random) -> None:
    """A type of jobs more or less, or another priority."""
    types = file["tree"]["Parallel"]["children"][1]["Jobs"]["types"]
    change, name = pick.random(), pick.choice(types)
    if change < 0.4:
        file["jobs"][name]["priority"] = pick.randint(0, 5)
    elif change < 0.6 and len(types) > 1:
        types.remove(name)
        del file["jobs"][name]
    else:
        new = pick.choice(["j7", "j8", "j9"])
        if new not in types:
            file["jobs"][new] = _random_type(pick, "travel" in file)
            types.insert(pick.randint(0, len(types)), new)


CHANGES: list[Callable[[File, random.Random], None]] = [
    _other_values,
    _other_values,
    _other_places,
    _other_name_of_parameter,
    _other_tree,
    _other_tree,
    _other_attempts,
    _other_task,
    _other_robots,
    _other_types,
]
