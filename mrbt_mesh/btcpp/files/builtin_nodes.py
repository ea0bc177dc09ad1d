"""The nodes that BehaviorTree.CPP 4 registers itself: ports, defaults, numbers of children."""

from __future__ import annotations

from mrbt_mesh.btcpp.files.document import Category, Direction, NodeManifest, Port

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
# How many cases each has, besides its last child.
SWITCHES = {f"Switch{cases}": cases for cases in range(2, 7)}


def _port(
    name: str, kind: str = ANY, default: str | None = None, direction: Direction = Direction.INPUT
) -> Port:
    return Port(name, direction, kind, default)


def _table() -> dict[str, NodeManifest]:
    control, decorator = Category.CONTROL, Category.DECORATOR
    action, condition = Category.ACTION, Category.CONDITION
    models: dict[str, NodeManifest] = {}

    def add(category: Category, names: str, *ports: Port) -> None:
        for name in names.split():
            models[name] = NodeManifest(name, category, {port.name: port for port in ports})

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
    add(action, "UnsetBlackboard", _port("key"))
    add(action, "Sleep", _port("msec", UNSIGNED))
    add(action, "WasEntryUpdated", _port("entry"))
    return models


BUILTIN = _table()

# Control nodes of Nav2 that appear in many files without a model.
NAV2_CONTROLS = frozenset(
    {
        "PipelineSequence",
        "RecoveryNode",
        "RoundRobin",
        "NonblockingSequence",
        "PersistentSequence",
    }
)
# Nav2's controls and decorators that are built in here: their ports are read, but for this one's.
NAV2_BUILTIN = frozenset(
    {
        *("PipelineSequence", "RecoveryNode", "RoundRobin", "RateController"),
        *("DistanceController", "SpeedController", "GoalUpdater"),
    }
)
NAV2_OUTPUTS = frozenset({"output_goal", "output_goals"})
# Nav2's leaves that are conditions; its files come without models.
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
# Types of a constant queue's items.
LOOP_ITEMS = {"LoopInt": INTEGER, "LoopBool": BOOLEAN, "LoopDouble": "double", "LoopString": TEXT}
STATUS_NAMES = ("SUCCESS", "FAILURE", "RUNNING", "SKIPPED", "IDLE")


def children_allowed(name: str, category: Category) -> tuple[int, int | None]:
    """The fewest and the most children of a node; None: no limit."""
    if name in ("IfThenElse", "WhileDoElse"):
        return 2, 3
    if name == "TryCatch":
        return 2, None
    if cases := SWITCHES.get(name):
        return cases + 1, cases + 1
    if name == "RecoveryNode":
        return 2, 2
    if category is Category.CONTROL:
        return 1, None
    return (1, 1) if category is Category.DECORATOR else (0, 0)


def category_of(name: str, tag: str, models: dict[str, NodeManifest], children: int) -> Category:
    """A node's category: as it is registered, else by its tag, else guessed from its children.

    So an <Action ID="Inverter"> is a decorator, as BehaviorTree.CPP takes it.
    """
    model = BUILTIN.get(name) or models.get(name)
    if model is not None and tag != Category.SUBTREE:
        return model.category
    if tag in frozenset(Category):
        return Category(tag)
    if name in NAV2_CONTROLS or children > 1:
        return Category.CONTROL
    if children:
        return Category.DECORATOR
    return Category.CONDITION if name in NAV2_CONDITIONS else Category.ACTION
