"""What people who know rclpy type, and what it is called here: one table of attributes and one of keywords.

Decides which names simply work, because they mean the same, and what an `AttributeError` or `TypeError` says about the
others. Type checkers see none of it: they report every name of the tables as unknown. Nothing of it costs anything
where a message passes; keywords are looked at where things are made or waited for.
"""

from __future__ import annotations

import functools
import inspect
import sys
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    Answer: TypeAlias = Callable[[Any], Any]

ClassT = TypeVar("ClassT", bound=type)


def same(ours: str) -> Answer:
    """Our attribute of another name."""
    return lambda owner: getattr(owner, ours)


def getter(ours: str) -> Answer:
    """A method without arguments where we have an attribute."""
    return lambda owner: lambda: getattr(owner, ours)


def closing(_: Any) -> Callable[[Any], bool]:
    """``node.destroy_publisher(publisher)`` is ``publisher.close()``."""

    def destroy(entity: Any) -> bool:
        entity.close()
        return True

    return destroy


_RESOLVED = {"destroy": same("close")}
_ON_SET = "node.add_{}_set_callback(f), where the value of a parameter is parameter.value.value"
_LISTS = "the node keeps no public list of them: keep what create_{} returned"
_EXECUTOR = "there are no executors: spin(node) or run(main) serves all nodes on asyncio's event loop"

ATTRIBUTES: dict[str, dict[str, Answer | str]] = {
    "Node": {
        "get_logger": getter("logger"),
        "get_clock": getter("clock"),
        "get_name": getter("name"),
        "get_namespace": getter("namespace"),
        "get_fully_qualified_name": getter("fully_qualified_name"),
        "destroy_node": same("close"),
        "destroy_publisher": closing,
        "destroy_subscription": closing,
        "destroy_client": closing,
        "destroy_service": closing,
        "destroy_timer": closing,
        "destroy_lifecycle_publisher": closing,
        "destroy_rate": "a rate holds nothing; leave it",
        "get_parameter_or": "node.get_parameter(name, type, default)",
        "get_parameter_type": "node.describe_parameter(name).type",
        "get_parameter_types": "node.describe_parameter(name).type",
        "describe_parameters": "node.describe_parameter(name)",
        "add_pre_set_parameters_callback": _ON_SET.format("pre"),
        "add_on_set_parameters_callback": _ON_SET.format("on"),
        "add_post_set_parameters_callback": _ON_SET.format("post"),
        "remove_pre_set_parameters_callback": "close() of what node.add_pre_set_callback(f) returned",
        "remove_on_set_parameters_callback": "close() of what node.add_on_set_callback(f) returned",
        "remove_post_set_parameters_callback": "close() of what node.add_post_set_callback(f) returned",
        "get_node_names_and_namespaces": "node.get_nodes()",
        "get_node_names_and_namespaces_with_enclaves": "node.get_nodes()",
        "create_guard_condition": "asyncio.Event, or loop.call_soon_threadsafe(f) from another thread",
        "create_task": "asyncio.create_task(coroutine)",
        "spin": "spin(node), or run(main) for an async function",
        "spin_once": "await what you wait for, such as subscription.receive(timeout_s=1); in plain code its _sync form",
        "executor": _EXECUTOR,
        "default_callback_group": "there are no callback groups: plain functions run one at a time, async ones overlap",
        "publishers": _LISTS.format("publisher"),
        "subscriptions": _LISTS.format("subscription"),
        "clients": _LISTS.format("client"),
        "services": _LISTS.format("service"),
        "timers": _LISTS.format("timer"),
        "trigger_configure": "await node.configure()",
        "trigger_activate": "await node.activate()",
        "trigger_deactivate": "await node.deactivate()",
        "trigger_cleanup": "await node.cleanup()",
        "trigger_shutdown": "await node.shutdown()",
    },
    "Publisher": {
        **_RESOLVED,
        "topic_name": same("topic"),
        "qos_profile": same("qos"),
        "get_subscription_count": getter("subscription_count"),
        "wait_for_all_acked": "await publisher.wait_for_acknowledged(timeout_s=...)",
        "msg_type": "publisher.message_type, the name of the type",
    },
    "Subscription": {
        **_RESOLVED,
        "topic_name": same("topic"),
        "qos_profile": same("qos"),
        "get_publisher_count": getter("publisher_count"),
        "msg_type": "subscription.message_type, the name of the type",
        "callback": "a callback cannot be changed: close() the subscription and create another one",
    },
    "Client": {
        **_RESOLVED,
        "srv_name": same("name"),
        "service_name": same("name"),
        "service_is_ready": same("service_is_available"),
        "call_async": "await client.call(request), or asyncio.create_task(client.call(request)) to go on meanwhile",
        "remove_pending_request": "cancel() of the task that awaits client.call(request)",
        "srv_type": "client.service_type, the name of the type",
    },
    "ServiceServer": {
        **_RESOLVED,
        "srv_name": same("name"),
        "service_name": same("name"),
        "srv_type": "service.service_type, the name of the type",
        "callback": "a handler cannot be changed: close() the service and create another one",
        "send_response": "request.respond(response) of a service without handler: async for request in service",
    },
    "Timer": {
        **_RESOLVED,
        "timer_period_ns": "timer.period.nanoseconds, and timer.change_period(seconds)",
        "time_since_last_call": "await timer.tick() returns it, for a timer without callback",
        "callback": "a callback cannot be changed: close() the timer and create another one",
    },
    "Rate": {"destroy": "a rate holds nothing; leave it"},
    "ActionClient": {
        **_RESOLVED,
        "server_is_ready": same("server_is_available"),
        "send_goal_async": "await client.send_goal(goal); it raises GoalRejectedError when the goal is not accepted",
    },
    "ClientGoal": {
        "get_result_async": "await goal.result(), which returns the status and the result",
        "get_result": "await goal.result(), which returns the status and the result",
        "cancel_goal_async": "await goal.cancel(); it raises CancelError when the server does not agree",
        "cancel_goal": "await goal.cancel(); it raises CancelError when the server does not agree",
    },
    "ActionServer": {
        **_RESOLVED,
        "register_execute_callback": "execute, the third argument of create_action_server",
        "register_goal_callback": "create_action_server(..., accept=f)",
        "register_cancel_callback": "create_action_server(..., on_cancel=f)",
        "register_handle_accepted_callback": "create_action_server(..., policy=...), or accept=f answering DEFER",
    },
    "ServerGoal": {
        "is_cancel_requested": same("cancel_requested"),
        "destroy": "a goal holds nothing; leave it",
    },
    "Context": {
        "get_domain_id": getter("domain_id"),
        "shutdown": same("close"),
        "try_shutdown": same("close"),
        "ok": "not context.is_closed",
        "init": "a context is open when it is made: Context(domain_id)",
        "on_shutdown": "what comes behind `async with context`, or behind run(main)",
    },
    "RosLogger": {
        "set_level": same("setLevel"),
        "get_effective_level": same("getEffectiveLevel"),
        "is_enabled_for": same("isEnabledFor"),
    },
}
"""Our class -> name in rclpy -> what takes its place: something that means the same, or what to say."""

MODULE = {
    "init": "nothing to call before a node is made; ROS arguments are those of sys.argv, or Context(args=...)",
    "shutdown": "node.close(), which leaving `async with node`, spin and run do, too",
    "try_shutdown": "node.close(), which leaving `async with node`, spin and run do, too",
    "ok": "not node.is_closed; run and spin end by themselves at Ctrl-C",
    "create_node": "Node(name)",
    "spin_once": "await what you wait for, such as subscription.receive(timeout_s=1); in plain code its _sync form",
    "spin_until_future_complete": "await the call itself: response = await client.call(request, timeout_s=5)",
    "get_global_executor": _EXECUTOR,
    "SingleThreadedExecutor": _EXECUTOR,
    "MultiThreadedExecutor": _EXECUTOR,
    "ExternalShutdownException": "spin and run return at SIGTERM and Ctrl-C",
    "MutuallyExclusiveCallbackGroup": "plain functions run one at a time, and asyncio.Lock keeps async ones apart",
    "ReentrantCallbackGroup": "async functions overlap; create_subscription(..., concurrency=4) for one subscription",
    "ReliabilityPolicy": "Reliability, or QoSProfile(depth=5).best_effort()",
    "QoSReliabilityPolicy": "Reliability, or QoSProfile(depth=5).best_effort()",
    "DurabilityPolicy": "Durability, or QoSProfile(depth=1).transient_local()",
    "QoSDurabilityPolicy": "Durability, or QoSProfile(depth=1).transient_local()",
    "HistoryPolicy": "History, or QoSProfile().keep_all()",
    "QoSHistoryPolicy": "History, or QoSProfile().keep_all()",
    "qos_profile_sensor_data": "rosidl_py_gen.runtime.qos.SENSOR_DATA",
    "qos_profile_system_default": "rosidl_py_gen.runtime.qos.SYSTEM_DEFAULT",
    "qos_profile_services_default": "rosidl_py_gen.runtime.qos.SERVICES_DEFAULT",
    "CancelResponse": "GoalDecision, or True and False",
    "GoalResponse": "GoalDecision, or True and False",
    "SetParametersResult": "SetResult",
    "Future": "asyncio.Future",
    "ROSClock": "Clock(ClockType.ROS_TIME), or node.clock",
}
"""Names of rclpy's modules -> what takes their place."""

KEYWORDS = {
    "qos_profile": "qos",
    "timeout_sec": "timeout_s",
    "callback_group": "no callback groups: plain functions run one at a time, async ones overlap",
    "qos_overriding_options": "no overrides of QoS by parameters; declare a parameter and make the profile of it",
    "node_name": "name",
    "parameter_overrides": "overrides, a dict of names and values",
    "allow_undeclared_parameters": "allow_undeclared",
    "automatically_declare_parameters_from_overrides": "declare_overrides",
    "start_parameter_services": "start_services",
    "enable_logger_service": "logger_services",
    "cli_args": "context=Context(args=...)",
    "use_global_arguments": "context=Context(args=[])",
    "topic_name": "topic",
    "srv_name": "name",
    "service_name": "name",
    "action_type": "action",
    "action_name": "name",
    "callback": "handler",
    "timer_period_sec": "period_s",
    "autostart": "timer.cancel() behind it",
    "frequency": "frequency_hz",
    "value": "default",
    "alternative_value": "default",
    "parameter_name": "name",
    "execute_callback": "execute",
    "goal_callback": "accept",
    "cancel_callback": "on_cancel",
    "handle_accepted_callback": "policy, or accept=f answering GoalDecision.DEFER",
    "result_timeout": "result_timeout_s",
    "feedback_callback": "async for feedback in goal.feedback()",
    "goal_uuid": "goal_id, 16 bytes",
    "threshold": "on_clock_change, min_forward and min_backward",
    "pre_callback": "pre",
    "post_callback": "post",
    "throttle_duration_sec": "throttle_s",
    "throttle_time_source_type": "no other clock than the steady one",
}
"""Keyword of rclpy -> ours, or what to do."""

METHODS = {
    "Node": (
        "__init__",
        "create_publisher",
        "create_subscription",
        "create_service",
        "create_client",
        "create_timer",
        "create_rate",
        "create_action_server",
        "create_action_client",
        "declare_parameter",
        "get_parameter",
        "wait_for_node",
    ),
    "Client": ("call_sync", "wait_for_service"),
    "ActionClient": ("send_goal", "wait_for_server"),
    "Clock": ("create_jump_callback",),
}
"""Our class -> methods that know the keywords; not `Client.call`, whose every call would take 1 us longer."""


def knows_rclpy(cls: ClassT) -> ClassT:
    """Let a class answer for the names of rclpy that the tables have for it."""
    for name, answer in ATTRIBUTES.get(cls.__name__, {}).items():
        setattr(cls, name, Foreign(name, answer))  # no __getattr__: it would slow down every attribute of the class
    for name in METHODS.get(cls.__name__, ()):
        setattr(cls, name, _with_keywords(getattr(cls, name)))
    return cls


class Foreign:
    """One name of rclpy as an attribute of our class; an attribute of an object, or of a subclass, hides it."""

    __slots__ = ("_answer", "_name")

    def __init__(self, name: str, answer: Answer | str) -> None:
        self._name = name
        self._answer = answer

    def __get__(self, owner: object | None, kind: type) -> Any:
        if owner is not None and not isinstance(self._answer, str):
            return self._answer(owner)
        text = f"{kind.__name__!r} object has no attribute {self._name!r}, which is rclpy's"
        raise AttributeError(f"{text}; here: {self._answer}" if isinstance(self._answer, str) else text)


def _with_keywords(method: Callable[..., Any]) -> Callable[..., Any]:
    known = frozenset(inspect.signature(method).parameters)

    @functools.wraps(method)
    def call(*arguments: Any, **options: Any) -> Any:
        if options and not options.keys() <= known:
            refuse_keywords(method.__qualname__, [name for name in options if name not in known])
        return method(*arguments, **options)

    return call


def refuse_keywords(function: str, unknown: list[str]) -> None:
    """Raise `TypeError` for a keyword of rclpy among the unknown ones; the caller refuses the others."""
    for name in unknown:
        if name in KEYWORDS:
            raise TypeError(
                f"{function}() got an unexpected keyword argument {name!r}, which is rclpy's; here: {KEYWORDS[name]}"
            )


def refuse_module_name(module: str, name: str) -> None:
    """Raise `AttributeError` for what rclpy's modules have and ours does not; `ImportError` when it was imported."""
    if name in MODULE:
        _refuse(f"{module} has no {name!r}, which is rclpy's; here: {MODULE[name]}", sys._getframe(2).f_code.co_name)


def _refuse(text: str, asked_by: str) -> NoReturn:
    # ``from module import name`` throws away what an AttributeError says.
    raise ImportError(text) if asked_by == "_handle_fromlist" else AttributeError(text)
