"""Commands about services."""

import threading
import time

import messages
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import QoSProfile


def _answer(values):
    def handler(request, response):
        return messages.build(type(response), values)

    return handler


def _set_bool(request, response):
    response.success, response.message = request.data, f"got {request.data}"
    return response


def _echo(request, response):
    """Copy the fields that both have."""
    for name in response.get_fields_and_field_types():
        setattr(response, name, getattr(request, name))
    return response


def serve(peer, name, type, how, values=None, node="", note="", depth=10):
    """Serve: `how` is `echo`, `fixed` (with `values`) or `set_bool`; with `note`, the response of a Trigger."""
    requests = peer.entities["requests", name] = []
    handlers = {"echo": _echo, "fixed": _answer(values), "set_bool": _set_bool}

    def handler(request, response):
        requests.append(messages.to_plain(request))
        if note:
            response.success, response.message = True, note
            return response
        return handlers[how](request, response)

    node = peer.nodes.get(node, peer.node)
    peer.entities["service", name] = node.create_service(
        messages.load(type), name, handler, qos_profile=QoSProfile(depth=depth)
    )


def serve_slowly(peer, name, type, threads, seconds):
    """Serve in a node of its own, whose handlers sleep in several threads and echo."""

    def handler(request, response):
        time.sleep(seconds)  # what the test is about: handlers that take long
        return _echo(request, response)

    node = rclpy.create_node(name.strip("/"))
    executor = MultiThreadedExecutor(threads)
    executor.add_node(node)
    node.create_service(messages.load(type), name, handler, callback_group=ReentrantCallbackGroup())
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    peer.entities["slow", name] = executor, node, thread


def unserve(peer, name):
    made = peer.entities.pop(("service", name))
    peer.owner("services", made).destroy_service(made)


def requests(peer, name):
    """Return the received requests, oldest first."""
    return peer.entities["requests", name]


async def client(peer, name, type, node="", wait=True):
    node = peer.nodes.get(node, peer.node)
    made = peer.entities["client", name] = node.create_client(messages.load(type), name)
    if wait:
        await peer.until(made.service_is_ready)


async def ready(peer, name, expected=True):
    await peer.until(lambda: peer.entities["client", name].service_is_ready() == expected)


def unclient(peer, name):
    made = peer.entities.pop(("client", name))
    peer.owner("clients", made).destroy_client(made)


async def call(peer, name, requests_):
    """Send all requests at once and wait for all responses."""
    made = peer.entities["client", name]
    futures = [made.call_async(messages.build(made.srv_type.Request, values)) for values in requests_]
    return [messages.to_plain(await future) for future in futures]


async def many_clients(peer, name, type, clients, calls):
    """Call test_msgs/srv/BasicTypes from several clients at once; return the number of correct responses.

    Every response goes to every client. With the default depth of ten, a client that is not scheduled for a moment
    would lose its own response among those of the others.
    """
    deep = QoSProfile(depth=1000)
    made = [peer.node.create_client(messages.load(type), name, qos_profile=deep) for _ in range(clients)]
    for one in made:
        await peer.until(one.service_is_ready)
    tasks = [peer.executor.create_task(_call_often, one, index, calls) for index, one in enumerate(made)]
    right = [await task for task in tasks]
    for one in made:
        peer.node.destroy_client(one)
    return sum(right)


async def _call_often(client, index, calls):
    right = 0
    for number in range(calls):
        response = await client.call_async(client.srv_type.Request(int64_value=number, int32_value=index))
        right += (response.int64_value, response.int32_value) == (number, index)
    return right
