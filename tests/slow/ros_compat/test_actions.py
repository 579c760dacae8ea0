"""Action servers of the rclpy layer: goals that end late, and requests with the id of another goal."""

from __future__ import annotations

from pathlib import Path

from support.local_network import domain_id
from support.program_processes import run

PROGRAM = """
import time
import rclpy
from example_interfaces.action import Fibonacci
from action_msgs.msg import GoalInfo
from rclpy.action import ActionClient, ActionServer, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

rclpy.init()
node, group = rclpy.create_node("node"), ReentrantCallbackGroup()
executor = MultiThreadedExecutor(2)
executor.add_node(node)
decision, goals = Future(), []
"""
DUPLICATES = """
async def decide(goal):
    return await decision

server = ActionServer(
    node, Fibonacci, "count", print, goal_callback=decide, handle_accepted_callback=goals.append, callback_group=group
)
clients = [ActionClient(node, Fibonacci, "count", callback_group=group) for _ in range(2)]
while not all(client.server_is_ready() for client in clients):
    executor.spin_once(0.05)
sent = [client.send_goal_async(Fibonacci.Goal(), goal_uuid=UUID(uuid=[1] * 16)) for client in clients]
for _ in range(20):
    executor.spin_once(0.05)
decision.set_result(GoalResponse.ACCEPT)
for future in sent:
    executor.spin_until_future_complete(future, 10)
print(sorted(future.result().accepted for future in sent), len(goals))
rclpy.shutdown()
for end in (goals[0].execute, goals[0].succeed, goals[0].succeed):
    try:
        end()
    except Exception as error:
        print(type(error).__name__, goals[0].status)
"""
RETAINED = """
def execute(goal):
    goal.succeed()
    time.sleep(0.5)
    return Fibonacci.Result(sequence=[1])

server = ActionServer(node, Fibonacci, "count", execute, result_timeout=0.1, callback_group=group)
client = ActionClient(node, Fibonacci, "count", callback_group=group)
while not client.server_is_ready():
    executor.spin_once(0.05)
sent = client.send_goal_async(Fibonacci.Goal())
executor.spin_until_future_complete(sent, 10)
result = sent.result().get_result_async()
executor.spin_until_future_complete(result, 10)
print(result.result().status, list(result.result().result.sequence))
end = time.monotonic() + 10
while server._goal_handles and time.monotonic() < end:
    executor.spin_once(0.05)
print(len(server._goal_handles), len(server._result_futures))
"""

DESTROYED = """
def execute(goal):
    goal.succeed()
    goal.destroy()
    return Fibonacci.Result(sequence=[1])

server = ActionServer(node, Fibonacci, "count", execute, result_timeout=0.1, callback_group=group)
client = ActionClient(node, Fibonacci, "count", callback_group=group)
while not client.server_is_ready():
    executor.spin_once(0.05)
sent = client.send_goal_async(Fibonacci.Goal())
executor.spin_until_future_complete(sent, 10)
result = sent.result().get_result_async()
executor.spin_until_future_complete(result, 10)
print(result.result().status, list(result.result().result.sequence))
end = time.monotonic() + 10
while server._goal_handles and time.monotonic() < end:
    executor.spin_once(0.05)
print(len(server._goal_handles), len(server._result_futures))
handle = ServerGoalHandle(server, GoalInfo(), Fibonacci.Goal())
rclpy.shutdown()
node.destroy_node()
handle.destroy()
print(handle.status)
"""
MANY = """
server = ActionServer(node, Fibonacci, "count", print)
for number in range(4000):
    key = number.to_bytes(16, "little")
    info = GoalInfo(goal_id=UUID(uuid=list(key)))
    server._goal_handles[key] = ServerGoalHandle(server, info, Fibonacci.Goal())
begin = time.process_time()
server.destroy()
print(time.process_time() - begin < 0.5)
"""


def output_of(program: str, folder: Path) -> str:
    (folder / "program.py").write_text(PROGRAM + program)
    done = run("program.py", cwd=folder, ROS_DOMAIN_ID=str(domain_id()), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_second_goal_with_same_id_is_rejected_and_end_after_shutdown_raises_rcl_error(tmp_path: Path) -> None:
    assert output_of(DUPLICATES, tmp_path) == "[False, True] 1\n" + "RCLError 2\nRCLError 4\nRCLError 4\n"


def test_result_timeout_starts_when_execute_callback_returns(tmp_path: Path) -> None:
    assert output_of(RETAINED, tmp_path) == "4 [1]\n0 0\n"


def test_goal_that_its_execute_callback_destroys_sends_its_result_and_expires(tmp_path: Path) -> None:
    assert output_of(DESTROYED, tmp_path) == "0 [1]\n0 0\n0\n"


def test_server_with_thousands_of_goals_is_destroyed_at_once(tmp_path: Path) -> None:
    assert output_of(MANY, tmp_path) == "True\n"
