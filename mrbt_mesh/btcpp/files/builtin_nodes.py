"""BehaviorTree.CPP 4's built-in nodes and Nav2's: ports, defaults, numbers of children."""

from __future__ import annotations

from mrbt_mesh.btcpp.files.document import Category, Direction, NodeManifest, Port
from mrbt_mesh.btcpp.scripts.cpp_types import canonical_type
from mrbt_mesh.btcpp.scripts.values import ANY_TYPE

INTEGER, BOOLEAN, TEXT, STATUS, SCRIPT, LIST, UNSIGNED, ANY = (
    "int",
    "bool",
    "std::string",
    "BT::NodeStatus",
    "script",
    "list",
    "unsigned int",
    "",
)
REAL = "double"
# The number of cases of each Switch node, without its last (default) child.
SWITCHES = {f"Switch{cases}": cases for cases in range(2, 7)}


def _port(
    name: str, kind: str = ANY, default: str | None = None, direction: Direction = Direction.INPUT
) -> Port:
    return Port(name, direction, kind, default)


def _manifest(name: str, category: Category, *ports: Port) -> NodeManifest:
    return NodeManifest(name, category, {port.name: port for port in ports})


def _table() -> dict[str, NodeManifest]:
    control, decorator = Category.CONTROL, Category.DECORATOR
    action, condition = Category.ACTION, Category.CONDITION
    models: dict[str, NodeManifest] = {}

    def add(category: Category, names: str, *ports: Port) -> None:
        for name in names.split():
            models[name] = _manifest(name, category, *ports)

    add(control, "Sequence AsyncSequence SequenceWithMemory Fallback AsyncFallback")
    add(control, "ReactiveSequence ReactiveFallback IfThenElse WhileDoElse")
    add(
        control,
        "Parallel",
        _port("success_count", INTEGER, "-1"),
        _port("failure_count", INTEGER, "1"),
    )
    add(control, "ParallelAll", _port("max_failures", INTEGER, "1"))
    add(control, "TryCatch", _port("catch_on_halt", BOOLEAN, "false"))
    for name, cases in SWITCHES.items():
        case_ports = [_port(f"case_{number + 1}", TEXT) for number in range(cases)]
        add(control, name, _port("variable", TEXT), *case_ports)
    add(decorator, "Inverter ForceSuccess ForceFailure KeepRunningUntilFailure")
    add(decorator, "RetryUntilSuccessful", _port("num_attempts", INTEGER))
    add(decorator, "Repeat", _port("num_cycles", INTEGER))
    add(decorator, "Timeout", _port("msec", UNSIGNED))
    add(decorator, "Delay", _port("delay_msec", UNSIGNED))
    add(decorator, "RunOnce", _port("then_skip", BOOLEAN, "true"))
    add(decorator, "Precondition", _port("if", SCRIPT), _port("else", STATUS, "FAILURE"))
    add(
        decorator,
        "LoopInt LoopBool LoopDouble LoopString",
        _port("queue", LIST, direction=Direction.INOUT),
        _port("if_empty", STATUS, "SUCCESS"),
        _port("value", direction=Direction.OUTPUT),
    )
    add(decorator, "SkipUnlessUpdated WaitValueUpdate", _port("entry"))
    add(action, "AlwaysSuccess AlwaysFailure")
    add(action, "Script", _port("code", SCRIPT))
    add(condition, "ScriptCondition", _port("code", SCRIPT))
    add(action, "SetBlackboard", _port("value"), _port("output_key", direction=Direction.INOUT))
    add(action, "UnsetBlackboard", _port("key", TEXT))
    add(action, "Sleep", _port("msec", UNSIGNED))
    add(action, "WasEntryUpdated", _port("entry"))
    return models


BUILTIN = _table()


def _nav2_table() -> dict[str, NodeManifest]:
    control, decorator = Category.CONTROL, Category.DECORATOR
    frames = (_port("global_frame", TEXT), _port("robot_base_frame", TEXT))
    goals = (_port("goals"), _port("goal"))
    index = _port("current_child_idx", INTEGER, direction=Direction.INOUT)
    services = (_port("pause_service_name", TEXT), _port("resume_service_name", TEXT))
    models = (
        NodeManifest("PipelineSequence", control),
        NodeManifest("NonblockingSequence", control),
        _manifest("PersistentSequence", control, index),
        _manifest("PauseResumeController", control, *services),
        _manifest("RecoveryNode", control, _port("number_of_retries", INTEGER, "1")),
        _manifest("RoundRobin", control, _port("wrap_around", BOOLEAN, "false")),
        NodeManifest("SingleTrigger", decorator),
        _manifest("RateController", decorator, _port("hz", REAL, "10.0")),
        _manifest("DistanceController", decorator, _port("distance", REAL, "1.0"), *frames),
        _manifest(
            "SpeedController",
            decorator,
            _port("min_rate", REAL, "0.1"),
            _port("max_rate", REAL, "1.0"),
            _port("min_speed", REAL, "0.0"),
            _port("max_speed", REAL, "0.5"),
            *goals,
        ),
        _manifest(
            "GoalUpdater",
            decorator,
            _port("input_goal"),
            _port("input_goals"),
            _port("output_goal", direction=Direction.OUTPUT),
            _port("output_goals", direction=Direction.OUTPUT),
        ),
        _manifest("GoalUpdatedController", decorator, *goals),
        _manifest(
            "PathLongerOnApproach",
            decorator,
            _port("path"),
            _port("prox_len", REAL, "3.0"),
            _port("length_factor", REAL, "2.0"),
        ),
    )
    return {model.id: model for model in models}


# Nav2's controls and decorators, which the executor implements (`executor.nav2`).
NAV2_NODES = _nav2_table()
# Nav2's condition leaves, which must be known by name: Nav2's files have no models.
NAV2_CONDITIONS = frozenset(
    {
        *("ArePosesNear", "AreErrorCodesPresent", "DistanceTraveled", "GlobalUpdatedGoal"),
        *("GoalReached", "GoalUpdated", "InitialPoseReceived", "IsBatteryCharging"),
        *("IsBatteryLow", "IsGoalNearby", "IsPathValid", "IsStopped", "IsStuck"),
        *("IsWithinPathTrackingBounds", "PathExpiringTimer", "TimeExpired"),
        "TransformAvailable",
        *("WouldAControllerRecoveryHelp", "WouldAPlannerRecoveryHelp"),
        *("WouldARouteRecoveryHelp", "WouldASmootherRecoveryHelp"),
    }
)
# The item type of each Loop node's queue.
LOOP_ITEMS = {"LoopInt": INTEGER, "LoopBool": BOOLEAN, "LoopDouble": REAL, "LoopString": TEXT}
STATUS_NAMES = ("SUCCESS", "FAILURE", "RUNNING", "SKIPPED", "IDLE")


def entry_type(node: str, port: Port) -> str | None:
    """Return the type that a port gives to its entry: "" for any; None if its model has none."""
    if node not in BUILTIN:
        return canonical_type(port.type) if port.type else None
    if port.name == "value" and node in LOOP_ITEMS:
        return LOOP_ITEMS[node]
    if port.name == "entry":
        return ANY_TYPE
    if port.type == SCRIPT:
        return ANY if node == "ScriptCondition" else TEXT
    return ANY if port.type == LIST else port.type


def children_allowed(name: str, category: Category) -> tuple[int, int | None]:
    """Return the minimum and maximum number of children of a node; None: no limit."""
    if name in ("IfThenElse", "WhileDoElse"):
        return 2, 3
    if name == "TryCatch":
        return 2, None
    if cases := SWITCHES.get(name):
        return cases + 1, cases + 1
    if name == "RecoveryNode":
        return 2, 2
    if name == "PauseResumeController":
        return 1, 4
    if category is Category.CONTROL:
        return 1, None
    return (1, 1) if category is Category.DECORATOR else (0, 0)


def category_of(name: str, tag: str, models: dict[str, NodeManifest], children: int) -> Category:
    """Return a node's category: as registered, else by its tag, else guessed from its children.

    So, as in BehaviorTree.CPP, an <Action ID="Inverter"> is a decorator.
    """
    model = BUILTIN.get(name) or models.get(name) or NAV2_NODES.get(name)
    if model is not None and tag != Category.SUBTREE:
        return model.category
    if tag in frozenset(Category):
        return Category(tag)
    if children > 1:
        return Category.CONTROL
    if children:
        return Category.DECORATOR
    return Category.CONDITION if name in NAV2_CONDITIONS else Category.ACTION
