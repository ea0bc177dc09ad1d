"""Robots for a first try: each drives straight to where Nav2's action sends it, at 2 m/s.

It needs rclpy and nav2_msgs, and nothing of mrbt: `python3 virtual_robots.py A1 A2 A3`.
"""

import contextlib
import json
import math
import sys
import threading
import time

import rclpy
from nav2_msgs.action import NavigateToPose
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from std_srvs.srv import Trigger

SPEED = 2.0  # m/s
STEP_S = 0.1


class VirtualRobot:
    """One robot: an action, a service and a topic under its name."""

    def __init__(self, robot: str) -> None:
        self.robot = robot
        self.x = self.y = self.heading = 0.0
        self.newest = b""
        self.driving = threading.Lock()
        node = self.node = rclpy.create_node("base", namespace=robot)
        self.odometry = node.create_publisher(Odometry, "odom", 10)
        node.create_timer(STEP_S, self.tell_place)
        node.create_service(Trigger, "report", self.report)
        self.server = ActionServer(
            node,
            NavigateToPose,
            "navigate_to_pose",
            self.drive,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )
        self.say("ready")

    def say(self, event: str, **more: float) -> None:
        """A line for those who look on."""
        line = json.dumps({"t": time.time(), "robot": self.robot, "event": event, **more})
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    def drive(self, goal) -> NavigateToPose.Result:
        """Carry out a goal; a newer one takes its place."""
        self.newest = bytes(goal.goal_id.uuid)
        with self.driving:
            place = goal.request.pose.pose.position
            told = {"x": place.x, "y": place.y}
            self.say("start", **told)
            feedback = NavigateToPose.Feedback()
            while (left := math.hypot(place.x - self.x, place.y - self.y)) > 0:
                if goal.is_cancel_requested:
                    goal.canceled()
                    self.say("cancelled", **told)
                    return NavigateToPose.Result()
                if bytes(goal.goal_id.uuid) != self.newest:
                    goal.abort()
                    self.say("aborted", **told)
                    return NavigateToPose.Result(error_msg="there is a newer goal")
                self.heading = math.atan2(place.y - self.y, place.x - self.x)
                step = min(left, SPEED * STEP_S)
                self.x += step * math.cos(self.heading) if step < left else place.x - self.x
                self.y += step * math.sin(self.heading) if step < left else place.y - self.y
                feedback.distance_remaining = left - step
                goal.publish_feedback(feedback)
                time.sleep(STEP_S)
            goal.succeed()
            self.say("end", **told)
            return NavigateToPose.Result()

    def report(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Answer that all is well."""
        self.say("report")
        response.success, response.message = True, "all is well"
        return response

    def tell_place(self) -> None:
        """Say where it is."""
        message = Odometry()
        message.header.frame_id = "map"
        message.header.stamp = self.node.get_clock().now().to_msg()
        message.pose.pose.position.x, message.pose.pose.position.y = self.x, self.y
        message.pose.pose.orientation.z = math.sin(self.heading / 2)
        message.pose.pose.orientation.w = math.cos(self.heading / 2)
        self.odometry.publish(message)


def main(robots: list[str]) -> None:
    """Serve until Ctrl-C."""
    rclpy.init()
    executor = MultiThreadedExecutor(2 + 2 * len(robots))
    virtual = [VirtualRobot(robot) for robot in robots]
    for each in virtual:
        executor.add_node(each.node)
    executor.spin()


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main(sys.argv[1:])
