"""Functions of rclpy that programs replace to see the calls of callbacks, as instrumentation does."""
# ruff: noqa
# fmt: off

import sys
import time
import rclpy
import rclpy.executors
import rclpy.impl.rcutils_logger
from functools import partial, wraps
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import SetBool

"rclpy.action" in sys.modules
seen = []
original = rclpy.executors.await_or_execute


@wraps(original)
async def replacement(callback, *args):
    seen.append((getattr(callback, "__name__", type(callback).__name__), len(args)))
    return await original(callback, *args)


rclpy.executors.await_or_execute = replacement
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from test_msgs.action import Fibonacci

_ = rclpy.init(args=[])
n = Node("a", start_parameter_services=False)
done = []


def on_message(message): done.append("message")
async def on_message_async(message): done.append("async")
def on_message_with_info(message, info): done.append("info")
def on_timer(): done.append("timer")
async def on_timer_async(): done.append("timer async")
def on_guard(): done.append("guard")
def on_request(request, response): response.message = "yes"; return response
async def on_request_async(request, response): response.message = "later"; return response
def on_goal(goal): return GoalResponse.ACCEPT
def on_cancel(goal): return CancelResponse.ACCEPT
def on_accepted(goal): goal.execute()
def on_feedback(message): done.append("feedback")
def on_matched(info): done.append("matched")
def on_done(future): done.append("done")
def on_execute(goal):
    goal.publish_feedback(Fibonacci.Feedback(sequence=[1]))
    goal.succeed()
    return Fibonacci.Result(sequence=[1, 2])


def spun(condition, executor):
    """Spin until the condition holds; return the calls of the replacement."""
    seen.clear()
    end = time.time() + 10
    while not condition() and time.time() < end:
        executor.spin_once(timeout_sec=0.1)
    return sorted(set(seen))


def both(make):
    """Return the results under both executors."""
    results = []
    for kind in (SingleThreadedExecutor, partial(MultiThreadedExecutor, 2)):
        done.clear()
        executor = kind()
        executor.add_node(n)
        results.append(make(executor))
        executor.remove_node(n)
        executor.shutdown()
    return results


p = n.create_publisher(String, "t", 10)


def messages(executor, *callbacks):
    subscriptions = [n.create_subscription(String, "t", callback, 10) for callback in callbacks]
    end = time.time() + 10
    while p.get_subscription_count() < len(subscriptions) and time.time() < end:
        time.sleep(0.02)
    p.publish(String())
    found = spun(lambda: len(done) >= len(subscriptions), executor)
    for subscription in subscriptions: n.destroy_subscription(subscription)
    while p.get_subscription_count() and time.time() < end:
        time.sleep(0.02)
    return found


both(lambda executor: messages(executor, on_message, on_message_async, on_message_with_info))
both(lambda executor: messages(executor, partial(on_message)))


def timed(executor, callback):
    timer = n.create_timer(0.01, callback)
    found = spun(lambda: done, executor)
    n.destroy_timer(timer)
    return found


both(lambda executor: timed(executor, on_timer))
both(lambda executor: timed(executor, on_timer_async))


def guarded(executor):
    guard = n.create_guard_condition(on_guard)
    guard.trigger()
    found = spun(lambda: done, executor)
    n.destroy_guard_condition(guard)
    return found


both(guarded)


def called(executor, callback):
    service = n.create_service(SetBool, "s", callback)
    client = n.create_client(SetBool, "s")
    client.wait_for_service(10)
    future = client.call_async(SetBool.Request())
    future.add_done_callback(on_done)
    found = spun(lambda: "done" in done, executor)
    n.destroy_client(client)
    n.destroy_service(service)
    return found, future.result().message


both(lambda executor: called(executor, on_request))
both(lambda executor: called(executor, on_request_async))


def tasks(executor):
    executor.create_task(on_timer)
    executor.create_task(on_timer_async)
    return spun(lambda: len(done) == 2, executor)


both(tasks)


def acted(executor):
    server = ActionServer(n, Fibonacci, "fib", on_execute, goal_callback=on_goal, cancel_callback=on_cancel, handle_accepted_callback=on_accepted)
    client = ActionClient(n, Fibonacci, "fib")
    client.wait_for_server(10)
    calls = set()
    future = client.send_goal_async(Fibonacci.Goal(), feedback_callback=on_feedback)
    calls |= set(spun(future.done, executor))
    result = future.result().get_result_async()
    calls |= set(spun(lambda: result.done() and "feedback" in done, executor))
    client.destroy()
    server.destroy()
    return sorted(calls), result.result().status


both(acted)[0]


def events(executor):
    subscription = n.create_subscription(String, "e", on_message, 10, event_callbacks=SubscriptionEventCallbacks(matched=on_matched))
    publisher = n.create_publisher(String, "e", 10)
    found = spun(lambda: "matched" in done, executor)
    n.destroy_publisher(publisher)
    n.destroy_subscription(subscription)
    return found


both(events)


async def failing(callback, *args):
    try:
        return await original(callback, *args)
    except ZeroDivisionError as error:
        seen.append(type(error).__name__)
        raise


rclpy.executors.await_or_execute = failing


def divides(message): 1 / 0


def raised(executor):
    try:
        return messages(executor, divides)
    except Exception as error:
        return type(error).__name__, seen[-1:]
    finally:
        for subscription in list(n.subscriptions):
            if subscription.topic_name == "/t": n.destroy_subscription(subscription)
        time.sleep(0.5)


both(raised)[0]
rclpy.executors.await_or_execute = original
both(lambda executor: messages(executor, on_message))


class Counting(SingleThreadedExecutor):
    waits = takes = 0

    def wait_for_ready_callbacks(self, *args, **kwargs):
        handler, entity, node = super().wait_for_ready_callbacks(*args, **kwargs)
        self.waits += isinstance(handler, Future)
        return handler, entity, node

    def _take_subscription(self, sub):
        self.takes += 1
        return super()._take_subscription(sub)


counting = Counting()
counting.add_node(n)
done.clear()
messages(counting, on_message)
(counting.waits > 0, counting.takes, done)
original_wait = Executor.wait_for_ready_callbacks


def waiting(self, *args, **kwargs):
    result = original_wait(self, *args, **kwargs)
    seen.append(type(result[1]).__name__)
    return result


Executor.wait_for_ready_callbacks = waiting
both(lambda executor: timed(executor, on_timer))
Executor.wait_for_ready_callbacks = original_wait

lines = []
original_log = rclpy.impl.rcutils_logger.RcutilsLogger.log


def log(self, message, severity, name=None, **kwargs):
    logged = original_log(self, message, severity, name=name, **kwargs)
    lines.append((logged, message, int(severity), self.name if name is None else name))
    return logged


rclpy.impl.rcutils_logger.RcutilsLogger.log = log
n.get_logger().info("hello")
n.get_logger().debug("hello")
rclpy.logging.get_logger("other").warning("hello", once=True)
lines
rclpy.impl.rcutils_logger.RcutilsLogger.log = original_log
rclpy.shutdown()
