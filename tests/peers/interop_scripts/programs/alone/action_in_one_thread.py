"""The tutorial's action client and server with callbacks, in one executor of one thread; deferred execution; goals that
raise, or forget to say how they ended."""

import rclpy
from rclpy.action import ActionClient, ActionServer, GoalResponse
from rclpy.action import get_action_names_and_types, get_action_server_names_and_types_by_node
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from test_msgs.action import Fibonacci


class Both(Node):
    def __init__(self):
        super().__init__("both", namespace="arm")
        self.goals = []
        self.server = ActionServer(
            self,
            Fibonacci,
            "count",
            self.execute,
            goal_callback=lambda request: GoalResponse.ACCEPT,
            handle_accepted_callback=self.accepted,
        )
        self.client = ActionClient(self, Fibonacci, "count")
        self.done = self.create_guard_condition(lambda: None)
        self.results = []

    def accepted(self, goal_handle):
        print("accepted", goal_handle.request.order, goal_handle.status)
        self.goals.append(goal_handle)
        if len(self.goals) == 2:
            for handle in self.goals:
                handle.execute()
        elif len(self.goals) > 2:
            goal_handle.execute()

    async def execute(self, goal_handle):
        feedback = Fibonacci.Feedback(sequence=[goal_handle.request.order])
        goal_handle.publish_feedback(feedback)
        if goal_handle.request.order == 3:
            raise ValueError("three")
        if goal_handle.request.order != 4:  # 4 forgets to say how it ended
            goal_handle.succeed()
        return Fibonacci.Result(sequence=[1, 2, goal_handle.request.order])

    def send(self, order):
        future = self.client.send_goal_async(Fibonacci.Goal(order=order), feedback_callback=self.feedback)
        future.add_done_callback(self.response)

    def feedback(self, message):
        print("feedback", message.feedback.sequence)

    def response(self, future):
        handle = future.result()
        print("response", handle.accepted, type(handle).__name__)
        handle.get_result_async().add_done_callback(self.result)

    def result(self, future):
        self.results.append((future.result().status, list(future.result().result.sequence)))


rclpy.init()
node = Both()
executor = SingleThreadedExecutor()
executor.add_node(node)
assert node.client.wait_for_server(10)
print(get_action_names_and_types(node), get_action_server_names_and_types_by_node(node, "both", "/arm"))
node.send(1)
while not node.goals:
    executor.spin_once(timeout_sec=1)
node.send(2)
while len(node.results) < 2:
    executor.spin_once(timeout_sec=1)
for order in (3, 4):
    node.send(order)
    while len(node.results) < order:
        executor.spin_once(timeout_sec=1)
print(sorted(node.results))
for wrong in (
    lambda: node.client.send_goal_async("text"),
    lambda: ActionServer(node, Fibonacci, "x", "not callable"),
    lambda: ActionClient(node, str, "x"),
    lambda: ActionClient(node, Fibonacci, "not valid"),
    lambda: node.goals[0].succeed(),
):
    try:
        print(wrong())
    except Exception as error:
        print(type(error).__name__ if not isinstance(error, ValueError) else "ValueError")
node.server.destroy()
print(node.client.wait_for_server(timeout_sec=0.1))
node.destroy_node()
rclpy.shutdown()
