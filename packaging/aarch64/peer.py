"""The peer of node.py, with rclpy: offers the same under other names, and asks for what that node offers."""

from __future__ import annotations

import threading
import time

import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient, ActionServer
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci

CALLS = 200
rclpy.init()
node = rclpy.create_node("peer")
node.declare_parameter("speed", 0.5)


def answer(request, response):
    response.success, response.message = request.data, "rclpy"
    return response


def count(goal):
    for number in range(goal.request.order):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
        time.sleep(0.1)
    goal.succeed()
    return Fibonacci.Result(sequence=list(range(goal.request.order)))


kept = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
heard = threading.Event()


def hear(message):
    print("topic:", message.data, flush=True)
    heard.set()


node.create_subscription(String, "arm_says", hear, kept)
node.create_publisher(String, "peer_says", kept).publish(String(data="from rclpy"))
node.create_service(SetBool, "peer_set", answer)
server = ActionServer(node, Fibonacci, "peer_count", count)
client, actions = node.create_client(SetBool, "arm_set"), ActionClient(node, Fibonacci, "arm_count")
parameters = node.create_client(SetParameters, "/arm/set_parameters")
executor = MultiThreadedExecutor(4)
executor.add_node(node)
threading.Thread(target=executor.spin, daemon=True).start()


def wait(future):
    while not future.done():
        time.sleep(0.005)
    return future.result()


heard.wait(120)
assert client.wait_for_service(120)
for number in range(CALLS):
    assert wait(client.call_async(SetBool.Request(data=number % 2 == 0))).success == (number % 2 == 0)
print("service:", CALLS, "calls", flush=True)
steps = []
assert actions.wait_for_server(120)
goal = wait(actions.send_goal_async(Fibonacci.Goal(order=5), feedback_callback=lambda got: steps.append(got.feedback)))
result = wait(goal.get_result_async())
print("action:", result.status, list(result.result.sequence), "after", len(steps), "times feedback", flush=True)
while node.get_parameter("speed").value != 4.5:  # the other side sets it
    time.sleep(0.1)
value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=2.5)
assert parameters.wait_for_service(120)
request = SetParameters.Request(parameters=[Parameter(name="speed", value=value)])
print("parameter:", wait(parameters.call_async(request)).results[0].successful, flush=True)
time.sleep(2)
