"""Most frequently used names of rclpy, with their replacements, for the errors about unknown attributes.

docs/start/from-rclpy.md lists all others.
"""

from __future__ import annotations

_SPIN_ONCE = "await the result itself, such as subscription.receive(timeout_s=1); in plain code call its _sync form"
_EXECUTOR = "there are no executors: spin(node) or run(main) serves all nodes on asyncio's event loop"
_CLOSE = "node.close(), which `async with node`, spin and run call as well"
_RELIABILITY = "Reliability, or QoSProfile(depth=5).best_effort()"
_DURABILITY = "Durability, or QoSProfile(depth=1).transient_local()"
_HISTORY = "History, or QoSProfile().keep_all()"

HINTS = {
    # of nodes
    "add_on_set_parameters_callback": "node.add_on_set_callback(f); a parameter's value is parameter.value.value",
    "add_post_set_parameters_callback": "node.add_post_set_callback(f); a parameter's value is parameter.value.value",
    "add_pre_set_parameters_callback": "node.add_pre_set_callback(f); a parameter's value is parameter.value.value",
    "create_guard_condition": "asyncio.Event, or loop.call_soon_threadsafe(f) from another thread",
    "create_task": "asyncio.create_task(coroutine)",
    "default_callback_group": "no callback groups: plain functions run one at a time, async functions overlap",
    "describe_parameters": "node.describe_parameter(name)",
    "executor": _EXECUTOR,
    "get_node_names_and_namespaces": "node.get_nodes()",
    "get_parameter_or": "node.get_parameter(name, type, default)",
    "get_parameter_type": "node.describe_parameter(name).type",
    "remove_on_set_parameters_callback": "close() of the result of node.add_on_set_callback(f)",
    "trigger_activate": "await node.activate()",
    "trigger_configure": "await node.configure()",
    "spin": "spin(node), or run(main) for an async function",
    # of nodes and of the module
    "spin_once": _SPIN_ONCE,
    # of the module
    "CancelResponse": "GoalDecision, or True and False",
    "DurabilityPolicy": _DURABILITY,
    "ExternalShutdownException": "no exception: spin and run return at SIGTERM and Ctrl-C",
    "Future": "asyncio.Future",
    "GoalResponse": "GoalDecision, or True and False",
    "HistoryPolicy": _HISTORY,
    "MultiThreadedExecutor": _EXECUTOR,
    "MutuallyExclusiveCallbackGroup": "plain functions run one at a time; an asyncio.Lock keeps async functions apart",
    "QoSDurabilityPolicy": _DURABILITY,
    "QoSHistoryPolicy": _HISTORY,
    "QoSReliabilityPolicy": _RELIABILITY,
    "ReentrantCallbackGroup": "async functions overlap; create_subscription(..., concurrency=4) for one subscription",
    "ReliabilityPolicy": _RELIABILITY,
    "SetParametersResult": "SetResult",
    "SingleThreadedExecutor": _EXECUTOR,
    "create_node": "Node(name)",
    "init": "no call is needed before a node is created; Context(args=...) replaces the arguments of sys.argv",
    "ok": "not node.is_closed; run and spin return at Ctrl-C",
    "qos_profile_sensor_data": "SENSOR_DATA",
    "qos_profile_services_default": "SERVICES_DEFAULT",
    "qos_profile_system_default": "SYSTEM_DEFAULT",
    "shutdown": _CLOSE,
    "spin_until_future_complete": "await the call itself: response = await client.call(request, timeout_s=5)",
    "try_shutdown": _CLOSE,
}
"""Name in rclpy -> text about its replacement."""


def unknown_attribute(owner: str, name: str) -> str:
    """Return the text of the error for an attribute that `owner` does not have."""
    hint = f", which is rclpy's; here: {HINTS[name]}" if name in HINTS else ""
    return f"{owner} has no attribute {name!r}{hint}"
