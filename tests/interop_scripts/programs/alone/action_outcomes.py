"""An action server in a thread that spins: goals that succeed, are aborted, canceled, rejected, and one that raises."""

import threading
import time

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from test_msgs.action import Fibonacci


heard = []

def spin(executor):
    try:
        executor.spin()
    except AttributeError:
        pass  # real rclpy's, when shutdown in another thread comes between two looks


class Server(Node):
    def __init__(self):
        super().__init__("fibonacci_server")
        self._action_server = ActionServer(
            self,
            Fibonacci,
            "fibonacci",
            execute_callback=self.execute,
            callback_group=ReentrantCallbackGroup(),
            goal_callback=self.goal,
            cancel_callback=self.cancel,
        )

    def goal(self, goal_request):
        return GoalResponse.REJECT if goal_request.order > 100 else GoalResponse.ACCEPT

    def cancel(self, goal_handle):
        print("cancel asked for", goal_handle.request.order, goal_handle.is_active)
        return CancelResponse.ACCEPT

    def execute(self, goal_handle):
        order = goal_handle.request.order
        feedback = Fibonacci.Feedback()
        feedback.sequence = [0, 1]
        result = Fibonacci.Result()
        if order == 13:
            raise ValueError("thirteen")
        if order == 7:
            goal_handle.abort()
            result.sequence = [7]
            return result
        if order == 100:
            deadline = time.monotonic() + 20
            while not goal_handle.is_cancel_requested and time.monotonic() < deadline:
                time.sleep(0.01)
            goal_handle.canceled()
            return Fibonacci.Result(sequence=[100])
        for i in range(1, order):
            feedback.sequence.append(feedback.sequence[i] + feedback.sequence[i - 1])
            goal_handle.publish_feedback(feedback)
        deadline = time.monotonic() + 10
        while len(heard) < order - 1 and time.monotonic() < deadline:
            time.sleep(0.01)  # a client drops feedback that comes behind the result
        if order != 3:  # 3 forgets to say how it ended
            goal_handle.succeed()
        result.sequence = feedback.sequence
        return result


rclpy.init()
server, node = Server(), rclpy.create_node("fibonacci_client")
executor = MultiThreadedExecutor(4)
executor.add_node(server)
executor.add_node(node)
thread = threading.Thread(target=spin, args=(executor,), daemon=True)
thread.start()
client = ActionClient(node, Fibonacci, "fibonacci")
print(client.wait_for_server(timeout_sec=10), client.server_is_ready())


def wait(future):
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    assert done.wait(20)
    return future.result()


def ended(order):
    heard.clear()
    handle = wait(client.send_goal_async(Fibonacci.Goal(order=order), lambda f: heard.append(list(f.feedback.sequence))))
    return wait(handle.get_result_async()) if handle.accepted else None


def run(order):
    response = ended(order)
    if response is None:
        print(order, "rejected")
        return
    print(order, response.status == GoalStatus.STATUS_SUCCEEDED, response.status, list(response.result.sequence), len(heard))


while len(heard) < 4:  # it is lost, too, until the server's publisher knows the client, which nothing tells
    ended(5)
for order in (5, 7, 200, 3, 13):
    run(order)
handle = wait(client.send_goal_async(Fibonacci.Goal(order=100)))
result = handle.get_result_async()
answer = wait(handle.cancel_goal_async())
print(answer.return_code, len(answer.goals_canceling), bytes(answer.goals_canceling[0].goal_id.uuid) == bytes(handle.goal_id.uuid))
response = wait(result)
print(response.status == GoalStatus.STATUS_CANCELED, response.result)
answer = wait(handle.cancel_goal_async())
print("again", answer.return_code, len(answer.goals_canceling))
executor.shutdown()
thread.join()
client.destroy()
server._action_server.destroy()
node.destroy_node()
server.destroy_node()
rclpy.shutdown()
