"""Random missions: trees of all kinds of nodes, robots, capabilities, policies. One seed, one file.

They are written as mission files and read like any other, so that a failing one can be kept and
reduced by hand.
"""

from __future__ import annotations

import io
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.feature import features
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.chaos import random_robot

PROGRAM_FILE = Path(random_robot.__file__)
MAX_DEPTH = 5
# Node kinds by how often they are chosen.
_COMPOSITES = (Kind.SEQUENCE,) * 4 + (Kind.PARALLEL,) * 4 + (Kind.FALLBACK,) * 3
_DECORATORS = (
    *(Kind.RETRY,) * 3,
    *(Kind.REPEAT,) * 2,
    *(Kind.TIMEOUT,) * 2,
    *(Kind.INVERTER,) * 2,
    *(Kind.FORCE_SUCCESS,) * 2,
    Kind.FORCE_FAILURE,
    Kind.KEEP_RUNNING_UNTIL_FAILURE,
)
_EXPRESSIONS = (
    *(Kind.SEQUENCE,) * 2,
    *(Kind.FALLBACK,) * 2,
    *(Kind.PARALLEL,) * 2,
    Kind.INVERTER,
    Kind.FORCE_SUCCESS,
)
# A task, and what is to be done where it fails.
TRIED, INSTEAD = "tried", "instead"
# The tasks of jobs.
FIRST, SECOND = "first", "second"
# The task that reads the blackboard, what its entries may hold, and what the tree says of them.
READ = "read"
FOUND = ["a", "b", "c"]
VALUES: dict[str, list[Any]] = {
    "found": FOUND,
    "count": list(range(10)),
    "level": [-0.5, 2.5, 12, 19.9],
}
COMPARISONS = ["found == a", "found != b", "count >= 3", "count < 7", "level < 10", "level@R1 > 0"]
# In larger teams nothing is repeated for ever. Every robot plans at every event, so a run costs
# the square of the robots times the events, of which an endless mission has as many as it can.
MAX_ENDLESS_ROBOTS = 8


@dataclass(frozen=True)
class Generated:
    """A mission and the text of its file."""

    text: str
    mission: Mission

    @property
    def program(self) -> RobotProgram:
        """That of its robots."""
        drives = (self.mission.program or "").endswith(":driver")
        return random_robot.driver if drives else random_robot.robot


def generate_mission(seed: int) -> Generated:
    """The mission of one seed; `program` is the file next to it when it is kept."""
    data = _Generator(seed).mission()
    stream = io.StringIO()
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.dump(data, stream)
    text = f"# Generated: mrbt sim chaos --generated --seeds {seed}\n{stream.getvalue()}"
    return Generated(
        text, mission_from_yaml(text, f"generated mission {seed}", PROGRAM_FILE.parent)
    )


class _Generator:
    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.pick = random.Random(f"{seed}/mission")
        # Drawn apart: which nodes remember changes nothing else of a mission.
        self.memory = random.Random(f"{seed}/memory")
        self.remembers = self.memory.random() < 0.35
        # Likewise guards of several conditions, and a task with an alternative that some robots
        # fail at and others are lost for.
        self.guards = random.Random(f"{seed}/guards")
        self.guarded = self.guards.random() < 0.4
        self.alternatives = random.Random(f"{seed}/alternatives")
        self.trying = self.alternatives.random() < 0.4
        # Likewise local tasks with which robots may help and need not, in one mission of three.
        self.optional = random.Random(f"{seed}/optional")
        self.helping = self.optional.random() < 0.35
        # Likewise what features add.
        chaos = (each.chaos(seed) for each in features())
        self.of_features = [each for each in chaos if each is not None]
        # Likewise places between which robots travel, in one mission of four.
        self.places = random.Random(f"{seed}/places")
        likes_places = any(each.likes_places for each in self.of_features)
        self.travelling = self.places.random() < (0.7 if likes_places else 0.25)
        # Likewise jobs, in some missions.
        self.jobs = random.Random(f"{seed}/jobs")
        self.takes_jobs = self.jobs.random() < 0.15
        # Likewise a blackboard, in some missions.
        self.values = random.Random(f"{seed}/values")
        self.uses_values = self.values.random() < 0.15
        # And some teams stand by when they are done.
        self.stands_by = random.Random(f"{seed}/ends").random() < 0.15
        self.conditions = [f"c{i}" for i in range(self.pick.randint(1, 4))]
        self.local_tasks = [f"t{i}" for i in range(self.pick.randint(1, 6))]
        self.global_tasks: dict[str, Any] = {}
        self.leaves = 0
        # Coalitions and grants are in one mission of three, not to hide the rest.
        self.special = self.chance(0.35)
        count = self.pick.randint(9, 16) if self.chance(0.02) else self.pick.randint(2, 8)
        # Likewise drawn apart: some more teams in which not all are neighbours.
        crowd = random.Random(f"{self.seed}/crowd")
        if crowd.random() < 0.06:
            count = crowd.randint(9, 16)
        self.robots = [f"R{i}" for i in range(1, count + 1)]
        self.types = {f"T{i}": self.capabilities() for i in range(self.pick.randint(1, 3))}
        self.type_of = {robot: self.pick.choice(sorted(self.types)) for robot in self.robots}
        # Every local task is somebody's.
        for task in self.local_tasks:
            if not any(task in self.types[kind] for kind in self.type_of.values()):
                self.types[self.type_of[self.pick.choice(self.robots)]][task] = 1.0

    def chance(self, chance: float) -> bool:
        return self.pick.random() < chance

    def mission(self) -> dict[str, Any]:
        mission = self.usual_mission()
        if self.trying:
            self.add_alternative(mission)
        if self.takes_jobs:
            self.add_jobs(mission)
        if self.uses_values:
            self.add_blackboard(mission)
        if self.travelling:
            self.add_places(mission)
        for each in self.of_features:
            each.add(mission, self.robots, self.types)
        return mission

    def usual_mission(self) -> dict[str, Any]:
        tree = self.root()
        return {
            "mission": f"generated_{self.seed}",
            **({"ends": "never"} if self.stands_by else {}),
            "program": PROGRAM_FILE.name,
            "parameters": {
                "salt": self.seed,
                "tasks": {task: self.behaviour() for task in self.local_tasks},
                "sensors": self.sensors(),
            },
            "local_tasks": {
                task: {"work": self.pick.choice([0.3, 1.0, 1.0, 2.0, 3.0])}
                for task in self.local_tasks
            },
            "conditions": {name: self.condition_type() for name in self.conditions},
            "robot_types": {name: {"capabilities": able} for name, able in self.types.items()},
            "robots": dict(self.type_of),
            "global_tasks": self.global_tasks,
            "tree": tree,
        }

    def condition(self, pick: random.Random) -> Any:
        """A leaf that reads a condition, or an entry of the blackboard."""
        name = pick.choice(self.conditions)
        if self.uses_values and self.values.random() < 0.5:
            name = self.values.choice(COMPARISONS)
        return {str(Kind.CONDITION): name}

    def condition_type(self) -> dict[str, Any]:
        declared: dict[str, Any] = {"default": self.chance(0.3)}
        for each in self.of_features:
            each.add_to_condition(declared)
        return declared

    def capabilities(self) -> dict[str, float]:
        """Few different performances, so that many assignments are equally good."""
        able = [task for task in self.local_tasks if self.chance(0.6)]
        able = able or [self.pick.choice(self.local_tasks)]
        return {task: self.pick.choice([0.5, 1.0, 1.0, 2.0]) for task in able}

    def behaviour(self) -> dict[str, Any]:
        behaviour: dict[str, Any] = {}
        if self.chance(0.35):
            behaviour["fails_permille"] = self.pick.choice([50, 200, 500])
            behaviour["raises"] = self.chance(0.3)
        if self.chance(0.1):
            behaviour["loses_permille"] = 100
        if self.chance(0.3):
            behaviour["sets"] = {self.pick.choice(self.conditions): self.chance(0.7)}
        for each in self.of_features:
            each.add_to_behaviour(behaviour)
        return behaviour

    def sensors(self) -> dict[str, list[list[Any]]]:
        """Conditions that change by themselves, in the first seconds of a robot's life."""
        sensors = {}
        for robot in self.robots:
            if self.guarded and self.guards.random() < 0.4:
                times = sorted(self.guards.randrange(120) / 10 for _ in range(4))
                sensors[robot] = [
                    [at_s, self.guards.choice(self.conditions), self.guards.random() < 0.5]
                    for at_s in times
                ]
            elif self.chance(0.2):
                times = sorted(self.pick.randrange(80) / 10 for _ in range(self.pick.randint(1, 3)))
                sensors[robot] = [
                    [at_s, self.pick.choice(self.conditions), self.chance(0.5)] for at_s in times
                ]
        return sensors

    def add_alternative(self, mission: dict[str, Any]) -> None:
        """`Fallback(TRIED, INSTEAD)`, before everything else or beside it.

        Some robots always fail at the first one, some of the others lose it before they have tried.
        """
        pick = self.alternatives
        able = {
            robot: [n for n in (TRIED, INSTEAD) if pick.random() < 0.6] for robot in self.robots
        }
        able[pick.choice(self.robots)] = [TRIED, INSTEAD]
        tries = [robot for robot, names in able.items() if TRIED in names]
        failing = [robot for robot in tries if pick.random() < 0.5] or tries[:1]
        losses = {r: [[pick.randrange(60) / 10, TRIED]] for r in tries if pick.random() < 0.4}
        for name in (TRIED, INSTEAD):
            mission["local_tasks"][name] = {"work": pick.choice([0.5, 1.0, 2.0])}
        for robot, names in able.items():
            capabilities = dict.fromkeys(names, 1.0)
            mission["robots"][robot] = {"type": self.type_of[robot], "capabilities": capabilities}
        mission["parameters"]["tasks"][TRIED] = {"fails_on": failing}
        mission["parameters"]["losses"] = losses
        most = pick.choice([1, 1, 2])
        failure = pick.choice(["resilient", "first", "paper", "paper", {"after_s": 2.5}])
        needs = {TRIED: {"min": 1, "max": most}}
        tried: dict[str, Any] = {"needs": needs, "failure": failure}
        if pick.random() < 0.2:
            tried["simultaneous"] = True
        mission["global_tasks"] |= {TRIED: tried, INSTEAD: {"needs": {INSTEAD: {}}}}
        either = {str(Kind.FALLBACK): [TRIED, INSTEAD]}
        stages = [either, mission["tree"]]
        if pick.random() < 0.6:
            mission["tree"] = {str(Kind.SEQUENCE): stages}
        else:
            mission["tree"] = {str(Kind.PARALLEL): {"success": "all", "children": stages}}

    def add_jobs(self, mission: dict[str, Any]) -> None:
        """Two types of jobs, beside the tree."""
        pick = self.jobs
        for task in (FIRST, SECOND):
            mission["local_tasks"][task] = {
                "parameters": ["number"],
                "work": pick.choice([0.3, 0.5, 1.0]),
            }
            fails = pick.choice([0, 0, 100, 300])
            mission["parameters"]["tasks"][task] = {"fails_permille": fails}
            able = [kind for kind in sorted(self.types) if pick.random() < 0.7]
            for kind in able or sorted(self.types):
                mission["robot_types"][kind]["capabilities"][task] = 1.0
            need: dict[str, Any] = {"min": 1, "max": pick.choice([1, 1, 2])}
            if task == SECOND and pick.random() < 0.3:
                need = {"min": 1, "same_robot_as": {"global_task": f"{FIRST}($number)"}}
            special = pick.choice([{}, {}, {"exclusive": True}, {"simultaneous": True}])
            mission["global_tasks"][task] = {
                "parameters": ["number"],
                "needs": {f"{task}($number)": need},
                **({} if "same_robot_as" in need else special),
            }
        leaves: list[Any] = [f"{FIRST}($number)", f"{SECOND}($number)"]
        if pick.random() < 0.4:
            leaves.insert(1, self.condition(pick))
        either = {str(Kind.FALLBACK): [f"{FIRST}($number)", f"{SECOND}($number)"]}
        parameters = {"number": {"min": 1, "max": 3}}
        mission["jobs"] = {
            "both": {
                "parameters": parameters,
                "attempts": pick.choice([1, 2]),
                "tree": {str(Kind.SEQUENCE): leaves},
            },
            "either": {"parameters": parameters, "priority": 2, "tree": either},
        }
        at_most = pick.choice([1, 2, 3, 20])
        jobs = {str(Kind.JOBS): {"types": ["both", "either"], "at_most": at_most}}
        children = [mission["tree"], jobs] if pick.random() < 0.5 else [jobs, mission["tree"]]
        mission["tree"] = {str(Kind.PARALLEL): {"success": "all", "children": children}}
        mission["ends"] = "never"

    def add_blackboard(self, mission: dict[str, Any]) -> None:
        """Entries that tasks and sensors set, and a task that reads one, beside the tree; in a
        mission with jobs also one of each job.
        """
        pick = self.values
        mission["blackboard"] = {
            "found": {"values": FOUND},
            "count": {"min": 0, "max": 9, "default": pick.randrange(10)},
            "level": {"min": -5, "max": 20, "decimals": 1, "per": "robot"},
        }
        sets = {name: pick.sample(VALUES[name], 3) for name in VALUES if pick.random() < 0.7}
        tasks = [name for name in mission["local_tasks"] if pick.random() < 0.5]
        for name in tasks:
            chosen = {each: values for each, values in sets.items() if pick.random() < 0.6}
            mission["parameters"]["tasks"].setdefault(name, {})["values"] = chosen
        for robot in self.robots:
            times = sorted(pick.randrange(100) / 10 for _ in range(pick.choice([0, 0, 1, 3])))
            sensed = mission["parameters"]["sensors"].setdefault(robot, [])
            for at_s in times:
                name = pick.choice(sorted(VALUES))
                sensed.append([at_s, name, pick.choice(VALUES[name])])
            sensed.sort(key=lambda row: row[0])
        mission["local_tasks"][READ] = {"parameters": ["what"], "work": pick.choice([0.5, 2.0])}
        mission["local_tasks"][self.local_tasks[0]]["sets"] = ["found"]
        for kind in self.types:
            mission["robot_types"][kind]["capabilities"][READ] = 1.0
        least = min(pick.choice([1, 1, 2]), len(self.robots))
        need: dict[str, Any] = {"min": least, "max": least + pick.choice([0, 0, 1])}
        if pick.random() < 0.2:
            mission["parameters"]["tasks"][READ] = {"fails_permille": 300}
        special = pick.choice([{}, {}, {"simultaneous": True}, {"exclusive": True}])
        needs = {f"{READ}($what)": need}
        mission["global_tasks"][READ] = {"parameters": ["what"], "needs": needs, **special}
        read: Any = f"{READ}(${pick.choice(['found', 'count'])})"
        if pick.random() < 0.5:
            read = {str(Kind.SEQUENCE): [self.condition(pick), read]}
        children = [{str(Kind.FORCE_SUCCESS): read}, mission["tree"]]
        if "jobs" in mission:
            mission["blackboard"]["own"] = {"values": FOUND, "per": "job"}
            mission["local_tasks"][FIRST]["sets"] = ["own"]
            mission["parameters"]["tasks"][FIRST]["values"] = {"own": FOUND}
            leaves = mission["jobs"]["both"]["tree"][str(Kind.SEQUENCE)]
            is_first: Any = {str(Kind.CONDITION): "own == a"}
            leaves.append({str(Kind.FALLBACK): [is_first, f"{READ}($own)"]})
        mission["tree"] = {str(Kind.PARALLEL): {"success": "all", "children": children}}

    def add_places(self, mission: dict[str, Any]) -> None:
        """Most local tasks happen at a place; some teams drive by themselves."""
        pick, names = self.places, [f"p{number}" for number in range(self.places.randint(2, 5))]
        for task in mission["local_tasks"].values():
            if pick.random() < 0.7:
                task["at"] = pick.choice(names)
        if not any("at" in task for task in mission["local_tasks"].values()):
            return
        mission["travel"] = {
            "places": {name: [pick.randrange(30) / 10, pick.randrange(30) / 10] for name in names},
            "speed": pick.choice([1.0, 2.0, 5.0]),
            "start": {robot: pick.choice(names) for robot in self.robots},
            "objective": pick.choice(["makespan", "mean_completion"]),
            "horizon": pick.choice([1, 3, 6, 12]),
        }
        if pick.random() < 0.5:
            mission["program"] = f"{PROGRAM_FILE.name}:driver"
            fails = pick.choice([0, 50, 200])
            mission["parameters"]["ways"] = {"most_s": 1.5, "fails_permille": fails}

    # -- the tree -----------------------------------------------------------------------------

    def root(self) -> Any:
        """Several stages, most of which cannot fail, so that the mission takes its time."""
        stages = []
        for _ in range(self.pick.randint(2, 4)):
            stage = self.composite(2)
            stages.append(stage if self.chance(0.3) else {str(Kind.FORCE_SUCCESS): stage})
        if self.chance(0.75):
            return {str(Kind.SEQUENCE): stages}
        return {str(Kind.PARALLEL): {"success": "all", "children": stages}}

    def node(self, depth: int) -> Any:
        if depth >= MAX_DEPTH or self.chance(0.35):
            return self.leaf()
        return self.decorator(depth) if self.chance(0.35) else self.composite(depth)

    def leaf(self) -> Any:
        if self.chance(0.15):
            return self.condition(self.pick)
        if self.global_tasks and (self.leaves >= 12 or self.chance(0.15)):
            return self.pick.choice(sorted(self.global_tasks))  # one task at two places
        self.leaves += 1
        name = f"g{self.leaves}"
        self.global_tasks[name] = self.global_task()
        return name

    def composite(self, depth: int) -> Any:
        kind = self.pick.choice(_COMPOSITES)
        children = [self.node(depth + 1) for _ in range(self.pick.choice([1, 2, 2, 3]))]
        body: dict[str, Any] = {"children": children}
        if kind is Kind.PARALLEL:
            choices = ["all", "all", "any", self.pick.randint(1, len(children))]
            body["success"] = self.pick.choice(choices)
        elif self.guarded and self.guards.random() < 0.4:
            children.insert(0, self.expression(2))
        return self.with_memory(kind, body)

    def expression(self, depth: int) -> Any:
        """Conditions that decide together."""
        pick = self.guards
        if depth == 0 or pick.random() < 0.2:
            return self.condition(pick)
        kind = pick.choice(_EXPRESSIONS)
        if kind in (Kind.INVERTER, Kind.FORCE_SUCCESS):
            return {str(kind): self.expression(depth - 1)}
        body: dict[str, Any] = {"children": [self.expression(depth - 1) for _ in range(2)]}
        if kind is Kind.PARALLEL:
            body["success"] = pick.choice(["any", "all"])
        return {str(kind): body}

    def with_memory(self, kind: Kind, body: dict[str, Any]) -> Any:
        """In some missions controls remember, some Sequences choose, some Parallels fail early."""
        count = len(body["children"])
        if self.remembers:
            if kind is Kind.SEQUENCE and count in (2, 3) and self.memory.random() < 0.25:
                kind = Kind.IF_THEN_ELSE
            if kind is Kind.PARALLEL and self.memory.random() < 0.25:
                body["failures"] = self.memory.randint(1, count)
            choices = ["none", "while_running", "while_running"]
            if kind is Kind.SEQUENCE:
                choices.append("until_success")
            body["memory"] = self.memory.choice(choices)
        return {str(kind): body}

    def decorator(self, depth: int) -> Any:
        kind = self.pick.choice(_DECORATORS)
        child = self.node(depth + 1)
        limit = -1 if self.chance(0.1) else self.pick.randint(1, 3)
        if len(self.robots) > MAX_ENDLESS_ROBOTS:
            limit = abs(limit)
            kind = Kind.REPEAT if kind is Kind.KEEP_RUNNING_UNTIL_FAILURE else kind
        match kind:
            case Kind.RETRY:
                return {str(kind): {"attempts": limit, "do": child}}
            case Kind.REPEAT:
                return {str(kind): {"cycles": limit, "do": child}}
            case Kind.TIMEOUT:
                return {str(kind): {"seconds": self.pick.choice([0.5, 2.0, 10.0]), "do": child}}
        return {str(kind): child}

    def global_task(self) -> dict[str, Any]:
        count = min(self.pick.choice([1, 1, 1, 2]), len(self.local_tasks))
        chosen = self.pick.sample(self.local_tasks, count)
        task: dict[str, Any] = {"needs": {name: self.need(name) for name in chosen}}
        if self.helping and count > 1 and self.optional.random() < 0.5:
            task["needs"][self.optional.choice(chosen)]["min"] = 0
        if self.chance(0.3):
            task["failure"] = "paper"
        if self.chance(0.15):
            task["blocked"] = {"fail_after_s": self.pick.choice([1.0, 4.0])}
        if self.chance(0.15):
            task["preemptive"] = True
        if self.special and self.chance(0.4):
            task["simultaneous"] = True
        if self.special and self.chance(0.3):
            task["exclusive"] = True
            task["in_doubt"] = self.pick.choice(["hold", "fail", "retry"])
        return task

    def need(self, local_task: str) -> dict[str, Any]:
        able = sum(local_task in self.types[kind] for kind in self.type_of.values())
        least = min(self.pick.choice([1, 1, 1, 2, 2, 3]), able + self.chance(0.03))
        need: dict[str, Any] = {"min": least, "max": least + self.pick.choice([0, 0, 0, 1, 2])}
        for each in self.of_features:
            each.add_to_need(need)
        return need
