"""The leaves that Nav2 registers, with their ports and types, so that its files need no models.

Facts from Nav2's nav2_tree_nodes.xml and its documentation of the plugins. A type that is a ROS
message is left out; a program gets it as a text.
"""

from __future__ import annotations

from collections.abc import Iterable

from mrbt_mesh.btcpp.files.document import (
    SUBTREE,
    Category,
    Direction,
    NodeManifest,
    Port,
    pointer,
    ports,
    type_id,
)
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.values import ValueTypeError, read_text

# Ports of many nodes. Times are in milliseconds.
_SERVER = "server_name:std::string server_timeout:unsigned"
_SERVICE = "service_name:std::string server_timeout:unsigned"
_ERROR = "error_code_id:uint16_t error_msg:std::string"
_MOTION = f"time_allowance:double {_SERVER} disable_collision_checks:bool is_recovery:bool"
_ROUTE = "start_id:uint16_t goal_id:uint16_t start goal use_start:bool use_poses:bool"

# name: input ports > output ports.
_ACTIONS = f"""
BackUp: backup_dist:double backup_speed:double {_MOTION} > {_ERROR}
DriveOnHeading: dist_to_travel:double speed:double {_MOTION} > {_ERROR}
Spin: spin_dist:double {_MOTION} > {_ERROR}
Wait: wait_duration:double {_SERVER} is_recovery:bool > {_ERROR}
AssistedTeleop: {_MOTION} > {_ERROR}
CancelControl: {_SERVER}
CancelBackUp: {_SERVER}
CancelDriveOnHeading: {_SERVER}
CancelSpin: {_SERVER}
CancelAssistedTeleop: {_SERVER}
CancelWait: {_SERVER}
CancelComputeAndTrackRoute: {_SERVER}
ClearEntireCostmap: {_SERVICE}
ClearCostmapExceptRegion: {_SERVICE} reset_distance:double
ClearCostmapAroundRobot: {_SERVICE} reset_distance:double
ClearCostmapAroundPose: {_SERVICE} pose reset_distance:double
ReinitializeGlobalLocalization: {_SERVICE}
ComputePathToPose: goal start use_start:bool planner_id:std::string {_SERVER} > path {_ERROR}
ComputePathThroughPoses: goals start use_start:bool planner_id:std::string {_SERVER} > path {_ERROR}
ComputeRoute: {_ROUTE} {_SERVER} > planning_time path route {_ERROR}
ComputeAndTrackRoute: {_ROUTE} {_SERVER} > execution_time path route {_ERROR} \
last_node_id:uint16_t next_node_id:uint16_t current_edge_id:uint16_t rerouted:bool
RemovePassedGoals: input_goals radius:double robot_base_frame:std::string input_waypoint_statuses \
global_frame:std::string > output_goals output_waypoint_statuses
RemoveInCollisionGoals: {_SERVICE} input_goals use_footprint:bool cost_threshold:double \
consider_unknown_as_obstacle:bool input_waypoint_statuses > output_goals output_waypoint_statuses
SmoothPath: smoother_id:std::string unsmoothed_path max_smoothing_duration:double \
check_for_collisions:bool {_SERVER} > smoothed_path smoothing_duration:double was_completed:bool \
{_ERROR}
FollowPath: controller_id:std::string path goal_checker_id:std::string \
progress_checker_id:std::string path_handler_id:std::string {_SERVER} > {_ERROR}
NavigateToPose: goal behavior_tree:std::string {_SERVER} > {_ERROR}
NavigateThroughPoses: goals behavior_tree:std::string {_SERVER} > {_ERROR}
TruncatePath: distance:double input_path > output_path
TruncatePathLocal: input_path distance_forward:double distance_backward:double \
robot_frame:std::string transform_tolerance:double pose angular_distance_weight:double \
max_robot_pose_search_dist:double > output_path
PlannerSelector: topic_name:std::string default_planner:std::string > selected_planner:std::string
ControllerSelector: topic_name:std::string default_controller:std::string \
> selected_controller:std::string
SmootherSelector: topic_name:std::string default_smoother:std::string \
> selected_smoother:std::string
GoalCheckerSelector: topic_name:std::string default_goal_checker:std::string \
> selected_goal_checker:std::string
ProgressCheckerSelector: topic_name:std::string default_progress_checker:std::string \
> selected_progress_checker:std::string
DockRobot: use_dock_id:bool dock_id:std::string dock_pose dock_type:std::string \
max_staging_time:double navigate_to_staging_pose:bool {_SERVER} \
> success:bool num_retries:uint16_t {_ERROR}
UndockRobot: dock_type:std::string max_undocking_time:double {_SERVER} > success:bool {_ERROR}
GetPoseFromPath: path index:int > pose
GetCurrentPose: global_frame:std::string robot_base_frame:std::string > current_pose
ConcatenatePaths: input_path1 input_path2 > output_path
GetNextFewGoals: input_goals num_goals:uint16_t > output_goals
AppendGoalPoseToGoals: goal_pose input_goals > output_goals
ExtractRouteNodesAsGoals: route > goals
"""
_CONDITIONS = """
GoalReached: goal robot_base_frame:std::string global_frame:std::string
IsStuck:
IsStopped: velocity_threshold:double duration_stopped:unsigned
TransformAvailable: child:std::string parent:std::string
GoalUpdated: goal goals
GlobalUpdatedGoal: goal goals
IsBatteryLow: min_battery:double battery_topic:std::string is_voltage:bool
IsBatteryCharging: battery_topic:std::string
DistanceTraveled: distance:double global_frame:std::string robot_base_frame:std::string
TimeExpired: seconds:double
PathExpiringTimer: seconds:double path
InitialPoseReceived: initial_pose_received:bool
IsPathValid: path server_timeout:unsigned max_cost:unsigned consider_unknown_as_obstacle:bool
WouldAControllerRecoveryHelp: error_code:uint16_t
WouldAPlannerRecoveryHelp: error_code:uint16_t
WouldASmootherRecoveryHelp: error_code:uint16_t
WouldARouteRecoveryHelp: error_code:uint16_t
AreErrorCodesPresent: error_code:uint16_t error_codes_to_check
ArePosesNear: ref_pose target_pose global_frame:std::string tolerance:double
"""


def _models(category: Category, table: str) -> Iterable[NodeManifest]:
    for line in table.strip().splitlines():
        name, _, listed = line.partition(":")
        direction, found = Direction.INPUT, {}
        for word in listed.split():
            if word == ">":
                direction = Direction.OUTPUT
                continue
            port, _, kind = word.partition(":")
            found[port] = Port(port, direction, kind, None)
        yield NodeManifest(name, category, found)


NAV2_MODELS = {
    model.id: model
    for category, table in (
        (Category.ACTION, _ACTIONS),
        (Category.CONDITION, _CONDITIONS),
    )
    for model in _models(category, table)
}


def know_nav2(library: Library) -> None:
    """Give a library models of the Nav2 leaves in its trees, for types of which it has none.

    A model has the ports that the trees use. One that Nav2 does not have, or of which a tree gives
    a text that is no value of its type (nodes of other makers have the same names), is without a
    type; it is written as well as read if it points to an entry. Nodes of another category than
    Nav2's are not Nav2's.
    """
    used: dict[str, dict[str, list[str]]] = {}
    others = set()
    for source in library.trees.values():
        for element in source.element.walk():
            name, model = type_id(element), NAV2_MODELS.get(type_id(element))
            if model is None or element.tag == SUBTREE or library.model(name) is not None:
                continue
            if element.tag not in (name, model.category) or element.children:
                others.add(name)
            for port, text in ports(element).items():
                used.setdefault(name, {}).setdefault(port, []).append(text)
            used.setdefault(name, {})
    for name in used.keys() - others:
        model = NAV2_MODELS[name]
        found = {port: _port(model, port, given) for port, given in used[name].items()}
        library.models[name] = NodeManifest(name, model.category, found)


def _port(model: NodeManifest, name: str, texts: list[str]) -> Port:
    known = model.ports.get(name)
    if known is not None and all(_fits(text, name, known.type) for text in texts):
        return known
    if known is not None:
        return Port(name, known.direction, "", None)
    is_entry = all(pointer(text, name) is not None for text in texts)
    return Port(name, Direction.INOUT if is_entry else Direction.INPUT, "", None)


def _fits(text: str, name: str, kind: str) -> bool:
    """Whether a port's text is an entry, or a value of its type."""
    if pointer(text, name) is not None or not text:
        return True
    try:
        read_text(text, kind)
    except ValueTypeError:
        return False
    return True
