"""Actions: a client and a server in one process."""
# ruff: noqa
# fmt: off

import threading
import time
import rclpy
from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from rclpy.action import *
from rclpy.action.server import GoalEvent, ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from test_msgs.action import Fibonacci
from unique_identifier_msgs.msg import UUID

rclpy.init()  # ours: a context manager, as in Kilted
n = rclpy.create_node("n")
executor = MultiThreadedExecutor(4)
executor.add_node(n)
seen = []
go = threading.Event()


def execute(goal):
    if goal.request.order == 1:
        raise ValueError("one")
    if goal.request.order == 2:
        return Fibonacci.Result(sequence=[2])
    if goal.request.order == 3:
        go.wait(10)
        (goal.canceled if goal.is_cancel_requested else goal.succeed)()
        return Fibonacci.Result(sequence=[3])
    if goal.request.order == 4:
        goal.abort()
        return Fibonacci.Result(sequence=[4])
    goal.publish_feedback(Fibonacci.Feedback(sequence=[1, 2]))
    goal.succeed()
    seen.append((goal.is_active, goal.status, goal.is_cancel_requested))
    try:
        goal.succeed()
    except Exception as error:
        seen.append(type(error).__name__)
    return Fibonacci.Result(sequence=[5])


async def execute_async(goal):
    goal.succeed()
    return Fibonacci.Result(sequence=[6])


def decide(goal):
    return GoalResponse.REJECT if goal.order == 9 else "nonsense" if goal.order == 8 else GoalResponse.ACCEPT


def decide_cancel(goal):
    return CancelResponse.ACCEPT if goal.request.order == 3 else CancelResponse.REJECT


group = ReentrantCallbackGroup()
c = ActionClient(n, Fibonacci, "turn", callback_group=group)
(c.server_is_ready(), c.wait_for_server(timeout_sec=0.1))
s = ActionServer(n, Fibonacci, "turn", execute, callback_group=group, goal_callback=decide, cancel_callback=decide_cancel)
c.wait_for_server(timeout_sec=10)
c.server_is_ready()


def done(future):
    executor.spin_until_future_complete(future, 60)
    return future.result()


def goal(order, **kwargs):
    return done(c.send_goal_async(Fibonacci.Goal(order=order), **kwargs))


def spin(until):
    end = time.monotonic() + 60
    while not until() and time.monotonic() < end:
        executor.spin_once(0.1)
    return until()


g = goal(5, feedback_callback=lambda m: seen.append(m.feedback), goal_uuid=UUID(uuid=list(range(16))))
(g.accepted, g.goal_id, type(g).__name__)
done(g.get_result_async())
spin(lambda: len(seen) == 3 and g.status == 4)
sorted(map(str, seen))
done(g.get_result_async()).status
done(g.cancel_goal_async())
goal(5, goal_uuid=UUID(uuid=list(range(16)))).accepted
g = goal(9)
(g.accepted, g.stamp.sec, g.status)
done(g.get_result_async())
done(g.cancel_goal_async())
goal(8).accepted
done(goal(1).get_result_async())
done(goal(2).get_result_async())
done(goal(4).get_result_async())
g = goal(3)
(spin(lambda: g.status == 2), g.status)
answer = done(g.cancel_goal_async())
(answer.return_code, len(answer.goals_canceling), answer.goals_canceling[0].goal_id == g.goal_id)
(spin(lambda: g.status == 3), go.set())
done(g.get_result_async())
spin(lambda: g.status == 5)
s.register_execute_callback(execute_async)
done(goal(7).get_result_async())
s.register_execute_callback(5)


def result_of(value):
    """Return status and result if an execute callback returns a value, otherwise the exception that leaves `spin`."""
    from rclpy.executors import SingleThreadedExecutor

    node = rclpy.create_node("wrong")
    spinner = SingleThreadedExecutor()
    spinner.add_node(node)
    server = ActionServer(node, Fibonacci, "wrong", lambda goal: (goal.succeed(), value)[1])
    client = ActionClient(node, Fibonacci, "wrong")
    client.wait_for_server(timeout_sec=10)
    try:
        future = client.send_goal_async(Fibonacci.Goal())
        spinner.spin_until_future_complete(future, 10)
        future = future.result().get_result_async()
        spinner.spin_until_future_complete(future, 10)
        return future.result().status, list(future.result().result.sequence)
    except Exception as error:
        return type(error).__name__
    finally:
        server.destroy(), client.destroy()
        spinner.shutdown()
        node.destroy_node()


unencodable = Fibonacci.Result()
unencodable._sequence = "abc"
result_of(Fibonacci.Feedback(sequence=[1]))
[result_of(value) for value in (None, 5, "x", {"sequence": [1]}, Fibonacci.Result, UUID(), unencodable)] == [(4, [])] * 7  # ours: True, and errors in the log
s.register_cancel_callback(None)
held = []
s.register_handle_accepted_callback(held.append)
g = goal(7)
(spin(lambda: g.status == 1), held[0].status, held[0].is_active)
done(g.cancel_goal_async())
held[0].succeed()  # text
held[0].publish_feedback(5)  # text
held[0].execute()
done(g.get_result_async())
cancel = n.create_client(CancelGoal, "turn/_action/cancel_goal")
cancel.wait_for_service(10)
done(cancel.call_async(CancelGoal.Request(goal_info=GoalInfo(goal_id=UUID(uuid=[7] * 16)))))
done(cancel.call_async(CancelGoal.Request()))
goal(7, goal_uuid=UUID(uuid=[8] * 16)).accepted
spin(lambda: held[-1].goal_id.uuid[0] == 8)  # the server accepts a goal before it calls the function for it
ServerGoalHandle(s, GoalInfo(goal_id=UUID(uuid=[8] * 16)), Fibonacci.Goal())  # text
(held[-1].destroy(), held[-1].status, held[-1].is_active, held[-1].succeed())
done(cancel.call_async(CancelGoal.Request(goal_info=GoalInfo(goal_id=UUID(uuid=[8] * 16)))))
made = ServerGoalHandle(s, GoalInfo(goal_id=UUID(uuid=[9] * 16)), Fibonacci.Goal())
(made.status, made._update_state(GoalEvent.EXECUTE), made.status, made.succeed(), made.status)
c.send_goal_async(5)  # text
c.send_goal(5)  # text
c._cancel_goal_async(5)
ActionServer(n, Fibonacci, "b", 5)
ActionServer(n, Fibonacci, "b", print, result_timeout=-1)  # text
ActionServer(n, Fibonacci, "b", print, result_timeout=float("nan"))  # text
ActionServer(n, Fibonacci, "b", print, result_timeout=float("inf"))  # text
ActionServer(n, Fibonacci, "b", print, result_timeout=1e30)  # text
ActionServer(n, Fibonacci, "b", print, result_timeout=None)  # text
ActionServer(n, Fibonacci, "b", print, result_timeout="1")  # text
ActionServer(n, Fibonacci, "b", print, result_timeout=-1e-10).destroy()
ActionClient(n, Fibonacci, "")  # text
ActionClient(n, Fibonacci, "a b")  # text
sorted(get_action_names_and_types(n))
get_action_server_names_and_types_by_node(n, "n", "/")
get_action_client_names_and_types_by_node(n, "n", "/")
s.destroy()
c.destroy()
spinning = threading.Thread(target=lambda: executor.spin(), daemon=True)
spinning.start()
short = ActionServer(n, Fibonacci, "short", execute_async, result_timeout=0, callback_group=group)
c = ActionClient(n, Fibonacci, "short", callback_group=group)
c.wait_for_server(timeout_sec=10)
c.send_goal(Fibonacci.Goal(order=3)).status in (0, 4)
executor.shutdown()
(spinning.join(20), spinning.is_alive())  # the interpreter of real rclpy may abort while a thread is still in it
rclpy.shutdown()
