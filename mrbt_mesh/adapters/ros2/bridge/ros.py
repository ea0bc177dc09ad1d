"""The part that calls rclpy: clients of actions and services, publishers, subscriptions.

Everything runs in the thread that spins the node. The keepers make the decisions.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterable
from typing import Any

import rclpy
from action_msgs.srv import CancelGoal as CancelGoalService
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from unique_identifier_msgs.msg import UUID

from .goals import GoalKeeper
from .server import AskLife, AskResult, CancelGoal, SendCall, SendGoal, ServerEffect, ServerWatch
from .values import fill, find_type, read_field, reason_of, stamp_now
from .watch import LifeAnswers

# Simulated time should have arrived after this time.
CLOCK_S = 5.0
# Passes a step of a keeper to the bridge, which carries out its effects.
Apply = Callable[[Callable[[Any, float], "list[ServerEffect]"]], None]
Told = Callable[[Any, "dict[str, Any]"], None]


class RosNode:
    """The bridge's node and its executor. `on_tick` is called every `tick_s`.

    `arguments` are those after `--ros-args`, as launch files pass them to nodes.
    """

    def __init__(
        self, name: str, tick_s: float, on_tick: Callable[[], None], arguments: Iterable[str] = ()
    ) -> None:
        words = ["--ros-args", *arguments]
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
        self.node: Any = rclpy.create_node(name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._guard = self.node.create_guard_condition(on_tick)
        # The node's own clock stands still while a simulation is paused.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(tick_s, on_tick, clock=steady)
        self._clock_timer = self.node.create_timer(CLOCK_S, self._look_at_clock, clock=steady)

    def _look_at_clock(self) -> None:
        """Log once if simulated time does not arrive."""
        self._clock_timer.cancel()
        clock = self.node.get_clock()
        if clock.ros_time_is_active and clock.now().nanoseconds == 0:
            text = "use_sim_time is set, but nothing publishes /clock: `stamp: now` is 0"
            self.node.get_logger().warning(text)

    def wake(self) -> None:
        """Have `on_tick` called now. May be called from any thread."""
        self._guard.trigger()

    def spin_while(self, holds: Callable[[], bool]) -> None:
        """Spin the node as long as `holds()` is true."""
        while holds() and rclpy.ok():
            self._executor.spin_once(timeout_sec=1.0)

    def serve(
        self, task: dict[str, Any], apply: Apply, feedback: Told
    ) -> ActionEnd | ServiceEnd | PublisherEnd | LifecycleEnd:
        """Create the client end of a task's server. Raises rclpy's error for a bad name."""
        if task["kind"] == "action":
            return ActionEnd(self.node, task, apply, feedback)
        if task["kind"] == "srv":
            return ServiceEnd(self.node, task, apply)
        if task["kind"] == "lifecycle":
            return LifecycleEnd(self.node, task, apply)
        return PublisherEnd(self.node, task, apply)

    def listen(self, topic: dict[str, Any], told: Callable[[dict[str, Any]], None]) -> None:
        """Subscribe to a topic; `told` is called with its fields."""
        paths = [path for path, *_ in topic["fields"]]
        # A best-effort subscription also receives from reliable publishers.
        latched = topic["latched"]
        qos = QoSProfile(
            depth=1,
            reliability=ReliabilityPolicy.RELIABLE if latched else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )

        def heard(message: Any) -> None:
            told({path: read_field(message, path) for path in paths})

        kind = find_type(topic["type"], "msg")
        overrides = QoSOverridingOptions.with_default_policies()
        self.node.create_subscription(
            kind, topic["name"], heard, qos, qos_overriding_options=overrides
        )


class _LifeQuestions:
    """Requests that a server's node answers without side effects, to see whether it is alive."""

    def __init__(self, node: Any, apply: Apply) -> None:
        self._node = node
        self._apply = apply
        self._clients: dict[str, Any] = {}
        self._open: list[tuple[Any, Any]] = []
        self._answers = LifeAnswers()

    def client(self, service: str, kind: Any) -> Any:
        """Return the client of a service; it is created once."""
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, service)
        return self._clients[service]

    def ask(self, client: Any, request: Any, answered: Callable[[Any], None]) -> bool:
        """Send a request, even if an earlier one is open. Returns whether there is a server."""
        if not client.service_is_ready():
            return False
        future = client.call_async(request)
        self._open.append((client, future))
        future.add_done_callback(lambda done: answered(done.result()))
        return True

    def renew(self) -> None:
        """Drop the requests that were not answered."""
        for client, future in self._open:
            client.remove_pending_request(future)
        self._open.clear()

    def ask_nodes(self, names: Iterable[str]) -> None:
        """Request an empty list of parameters from nodes that DDS lists."""

        def heard(keeper: ServerWatch, now_s: float) -> list[ServerEffect]:
            return keeper.heard(now_s)

        def answered(_: Any) -> None:
            self._answers.answered(time.monotonic())
            self._apply(heard)

        clients = [self.client(f"{name}/get_parameters", GetParameters) for name in names]
        asked = [self.ask(client, GetParameters.Request(), answered) for client in clients]
        are_all_asked = bool(asked) and all(asked)
        if not are_all_asked and self._answers.does_listing_count(time.monotonic()):
            self._apply(heard)


class ActionEnd:
    """The client end of an action."""

    def __init__(self, node: Any, task: dict[str, Any], apply: Apply, feedback: Told) -> None:
        self._node, self._task, self._apply, self._feedback = node, task, apply, feedback
        self._type = find_type(task["type"], "action")
        self._client = ActionClient(node, self._type, task["name"])
        self._name = node.resolve_service_name(task["name"])
        self._questions = _LifeQuestions(node, apply)
        self._results: dict[bytes, Any] = {}

    def carry_out(self, effect: ServerEffect) -> None:
        """Carry out an effect. Raises UnfitError for a goal that does not fit the type."""
        if isinstance(effect, SendGoal):
            self._send(effect)
        elif isinstance(effect, CancelGoal):
            self._cancel(effect.goal_id)
        elif isinstance(effect, AskResult):
            self._ask_result(effect.goal_id)
        elif isinstance(effect, AskLife):
            self._ask_life()

    def _send(self, effect: SendGoal) -> None:
        goal = self._type.Goal()
        fill(goal, effect.body)
        stamp_now(goal, effect.body, self._node.get_clock().now().to_msg())
        paths = [path for path, *_ in self._task["feedback"]]
        goal_id = effect.goal_id

        def feedback(message: Any) -> None:
            self._feedback(goal_id, {path: read_field(message.feedback, path) for path in paths})

        future = self._client.send_goal_async(goal, feedback, UUID(uuid=list(goal_id)))
        future.add_done_callback(
            lambda done: self._apply(
                lambda keeper, now_s: keeper.answered(goal_id, done.result().accepted, now_s)
            )
        )

    def _cancel(self, goal_id: bytes) -> None:
        self._call_cancel(
            goal_id, lambda keeper, code, now_s: keeper.cancel_answered(goal_id, code, now_s)
        )

    def _call_cancel(
        self, goal_id: bytes, step: Callable[[GoalKeeper, int, float], list[ServerEffect]]
    ) -> None:
        request = CancelGoalService.Request()
        request.goal_info.goal_id = UUID(uuid=list(goal_id))
        client = self._questions.client(f"{self._name}/_action/cancel_goal", CancelGoalService)

        def answered(response: Any) -> None:
            self._apply(lambda keeper, now_s: step(keeper, response.return_code, now_s))

        self._questions.ask(client, request, answered)

    def _ask_result(self, goal_id: bytes) -> None:
        service = self._type.Impl.GetResultService
        client = self._questions.client(f"{self._name}/_action/get_result", service)
        earlier = self._results.pop(goal_id, None)
        if earlier is not None:
            client.remove_pending_request(earlier)
        request = service.Request()
        request.goal_id = UUID(uuid=list(goal_id))
        paths = [path for path, *_ in self._task["result"]]

        def answered(done: Any) -> None:
            self._results.pop(goal_id, None)
            status, result = done.result().status, done.result().result
            fields = {path: read_field(result, path) for path in paths}
            self._apply(
                lambda keeper, now_s: keeper.result(
                    goal_id, status, reason_of(result), fields, now_s
                )
            )

        self._results[goal_id] = future = client.call_async(request)
        future.add_done_callback(answered)

    def _ask_life(self) -> None:
        self._questions.renew()
        found = self._node.get_publishers_info_by_topic(f"{self._name}/_action/status")
        servers = frozenset(bytes(info.endpoint_gid) for info in found)
        self._apply(lambda keeper, now_s: keeper.servers(servers, now_s))
        if not self._client.server_is_ready():
            found = get_action_names_and_types(self._node)
            _say_other_type(self._apply, self._task["type"], dict(found).get(self._name, []))
            return
        # Cancel an unknown goal: a server answers this without writing to its log.
        self._call_cancel(uuid.uuid4().bytes, lambda keeper, _, now_s: keeper.heard(now_s))


class ServiceEnd:
    """The client end of a service."""

    def __init__(self, node: Any, task: dict[str, Any], apply: Apply) -> None:
        self._node, self._task, self._apply = node, task, apply
        self._type = find_type(task["type"], "srv")
        self._client = node.create_client(self._type, task["name"])
        self._questions = _LifeQuestions(node, apply)
        self._call: Any = None

    def carry_out(self, effect: ServerEffect) -> None:
        """Carry out an effect. Raises UnfitError for a request that does not fit the type."""
        if isinstance(effect, SendCall):
            self._send(effect)
        elif isinstance(effect, AskLife):
            self._questions.renew()
            names, is_ready = self._servers(), self._client.service_is_ready()
            servers = frozenset(f"{name} {i}".encode() for i, name in enumerate(names))
            if servers or not is_ready:  # DDS does not know the names of some nodes
                self._apply(lambda keeper, now_s: keeper.servers(servers, now_s))
            if is_ready:
                self._questions.ask_nodes(names)
            else:
                name, wanted = self._client.srv_name, self._task["type"]
                found = self._node.get_service_names_and_types()
                _say_other_type(self._apply, wanted, dict(found).get(name, []))

    def _send(self, effect: SendCall) -> None:
        request = self._type.Request()
        fill(request, effect.body)
        stamp_now(request, effect.body, self._node.get_clock().now().to_msg())
        paths = [path for path, *_ in self._task["result"]]
        run = effect.run

        def answered(done: Any) -> None:
            response = done.result()
            fields = {path: read_field(response, path) for path in paths}
            if isinstance(getattr(response, "success", None), bool):
                fields["success"] = response.success
            text = reason_of(response)
            self._apply(lambda keeper, now_s: keeper.answered(run, text, fields, now_s))

        if self._call is not None:
            self._client.remove_pending_request(self._call)
        self._call = self._client.call_async(request)
        self._call.add_done_callback(answered)

    def _servers(self) -> list[str]:
        """Return the nodes that offer the service, sorted; several may have the same name."""
        found = []
        for name, namespace in self._node.get_node_names_and_namespaces():
            try:
                services = self._node.get_service_names_and_types_by_node(name, namespace)
            except RuntimeError:
                # The node has just ended.
                continue
            if self._client.srv_name in dict(services):
                found.append(_full_name(name, namespace))
        return sorted(found)


class PublisherEnd:
    """The publisher of a topic; its servers are the nodes that subscribe to it."""

    def __init__(self, node: Any, task: dict[str, Any], apply: Apply) -> None:
        self._node, self._apply = node, apply
        self._wanted = task["type"]
        self._type = find_type(self._wanted, "msg")
        overrides = QoSOverridingOptions.with_default_policies()
        self._publisher = node.create_publisher(
            self._type, task["name"], 10, qos_overriding_options=overrides
        )
        self._questions = _LifeQuestions(node, apply)

    def carry_out(self, effect: ServerEffect) -> None:
        """Carry out an effect. Raises UnfitError for a message that does not fit the type."""
        if isinstance(effect, SendCall):
            message = self._type()
            fill(message, effect.body)
            stamp_now(message, effect.body, self._node.get_clock().now().to_msg())
            self._publisher.publish(message)
            self._apply(lambda keeper, _: keeper.published(effect.run))
        elif isinstance(effect, AskLife):
            self._questions.renew()
            found = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
            names = {_full_name(info.node_name, info.node_namespace) for info in found}
            # Several subscribers are fine, so they count as one server.
            servers = frozenset({b"subscribers"} if found else ())
            self._apply(lambda keeper, now_s: keeper.servers(servers, now_s))
            if self._publisher.get_subscription_count():
                self._questions.ask_nodes(sorted(names))
            elif found:
                self._say_why_none_fits(found)

    def _say_why_none_fits(self, found: list[Any]) -> None:
        """Report that all subscribers have another type or an incompatible quality of service."""
        if all(info.topic_type != self._wanted for info in found):
            _say_other_type(self._apply, self._wanted, [info.topic_type for info in found])
            return
        own = self._publisher.qos_profile
        same = [info.qos_profile for info in found if info.topic_type == self._wanted]
        checks = [qos_check_compatible(own, each) for each in same]
        reasons = [why for fits, why in checks if fits == QoSCompatibility.ERROR]
        if reasons:
            text = f"has another quality of service: {reasons[0].strip().rstrip(';')}"
            self._apply(lambda keeper, _: keeper.unusable(text))


class LifecycleEnd:
    """The client end of a lifecycle node."""

    def __init__(self, node: Any, task: dict[str, Any], apply: Apply) -> None:
        self._apply = apply
        self._questions = _LifeQuestions(node, apply)
        self._client = self._questions.client(f"{task['name']}/get_state", GetState)

    def carry_out(self, effect: ServerEffect) -> None:
        """Request the node's state; other effects are ignored."""
        if isinstance(effect, AskLife):
            self._questions.renew()
            self._questions.ask(self._client, GetState.Request(), self._answered)

    def _answered(self, response: Any) -> None:
        state = response.current_state
        if state.id == State.PRIMARY_STATE_ACTIVE:
            self._apply(lambda keeper, now_s: keeper.heard(now_s))
        else:
            self._apply(lambda keeper, _: keeper.unusable(f"is {state.label}"))


def _say_other_type(apply: Apply, wanted: str, found: Iterable[str]) -> None:
    """Report that the server has another type, if there is one."""
    others = sorted({each for each in found if each != wanted})
    if others:  # the wanted type is always listed, by this client itself
        text = f"is there with the type {' and '.join(others)}, not {wanted}"
        apply(lambda keeper, _: keeper.unusable(text))


def _full_name(name: str, namespace: str) -> str:
    return f"{namespace.rstrip('/')}/{name}"
