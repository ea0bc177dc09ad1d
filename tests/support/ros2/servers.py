"""Servers of rclpy that do one thing each, for tests of the bridge: `python servers.py /A1`.

`work` (test_msgs/action/Fibonacci) counts to its order, fails for 13 and beside another goal,
refuses 0, and takes 3 s to stop at 777; `ask`
(std_srvs/srv/SetBool) says yes or no; `command` (std_msgs/msg/String) is answered on `done`; `door`
is a latched topic; `odom` says a place; `wave`
(std_msgs/msg/Bool) is heard; `manager` is a lifecycle node, which the commands
`activate` and `deactivate` change.
"""

import sys
import time

import rclpy
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci


def main(namespace: str) -> None:
    """Serve until the process is ended."""
    rclpy.init()
    node = rclpy.create_node("servers", namespace=namespace)
    done = node.create_publisher(String, "done", 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(Bool, "door", latched).publish(Bool(data=True))
    odometry = node.create_publisher(Odometry, "odom", 10)
    place = Odometry()
    place.pose.pose.position.x = 3.5
    node.create_timer(0.2, lambda: odometry.publish(place))

    working = []

    def work(goal):
        working.append(goal)
        try:
            return count(goal)
        finally:
            working.remove(goal)

    def count(goal):
        result = Fibonacci.Result(sequence=[0, 1])
        for _ in range(goal.request.order):
            if len(working) > 1:
                goal.abort()
                return result
            if goal.is_cancel_requested:
                time.sleep(3 if goal.request.order == 777 else 0)
                goal.canceled()
                return result
            result.sequence.append(result.sequence[-1] + 1)
            goal.publish_feedback(Fibonacci.Feedback(sequence=result.sequence))
            if goal.request.order == 13:
                goal.abort()
                return result
            time.sleep(0.1)
        goal.succeed()
        return result

    def ask(request, response):
        response.success, response.message = request.data, "so it is"
        return response

    def take(goal):
        return GoalResponse.ACCEPT if goal.order else GoalResponse.REJECT

    server = ActionServer(
        node,
        Fibonacci,
        "work",
        work,
        goal_callback=take,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=ReentrantCallbackGroup(),
    )
    manager = LifecycleNode("manager", namespace=namespace)
    manager.trigger_configure()

    def command(message):
        if message.data == "activate":
            manager.trigger_activate()
        elif message.data == "deactivate":
            manager.trigger_deactivate()
        done.publish(String(data=f"done: {message.data}"))

    node.create_service(SetBool, "ask", ask)
    node.create_subscription(String, "command", command, 10)
    node.create_subscription(Bool, "wave", lambda _: None, 10)
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    executor.add_node(manager)
    executor.spin()
    server.destroy()


if __name__ == "__main__":
    main(sys.argv[1])
