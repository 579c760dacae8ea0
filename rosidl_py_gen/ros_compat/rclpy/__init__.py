"""API of rclpy (ROS 2 Jazzy) on the nodes of rosidl_py_gen: `init` a context, create a `Node`, `spin`, `shutdown`."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, List, Optional

import rclpy.impl.implementation_singleton
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_rosout_default
from rclpy.signals import SignalHandlerOptions, install_signal_handlers, uninstall_signal_handlers
from rclpy.task import Future
from rclpy.utilities import explicit_context, get_default_context, get_rmw_implementation_identifier, ok
from rclpy.utilities import shutdown as _shutdown
from rclpy.utilities import try_shutdown as _try_shutdown

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node

_executor: Executor | None = None
_executor_lock = threading.RLock()


class InitContextManager:
    """Result of `init` since Kilted: a context manager that shuts the context down at the end of the block.

    Programs written for Jazzy pass the result of `init`, there None, as `context=` to a node. The object therefore also
    stands for the context that `init` opened.
    """

    def __init__(self, context: Context, explicit_context: Context | None, has_handlers: bool) -> None:
        self.context, self.installed_signal_handlers = context, has_handlers
        self.rosidl_context = explicit_context

    def __enter__(self) -> InitContextManager:
        return self

    def __exit__(self, *_: object) -> None:
        try_shutdown(context=None if self.context is get_default_context() else self.context)
        if self.installed_signal_handlers:
            uninstall_signal_handlers()


def init(
    *,
    args: list[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> InitContextManager:
    """Open a context; a block ``with rclpy.init():`` also shuts the context down.

    Args:
        args: command line with ``--ros-args``. [default: `sys.argv`]
        context: context to open. [default: the default context]
        domain_id: domain. [default: ``ROS_DOMAIN_ID``, else 0]
        signal_handler_options: signals that shut contexts down. [default: both for the default context, else none]

    Raises:
        RuntimeError: the context was opened before, or `domain_id` is negative.
        UnknownROSArgsError: an argument after ``--ros-args`` is unknown.
    """
    default, explicit = get_default_context(), explicit_context(context)
    context = default if explicit is None else explicit
    if signal_handler_options is None:
        signal_handler_options = SignalHandlerOptions.ALL if context is default else SignalHandlerOptions.NO
    context.init(args, domain_id=domain_id)
    install_signal_handlers(signal_handler_options)
    return InitContextManager(context, explicit, signal_handler_options != SignalHandlerOptions.NO)


def get_global_executor() -> Executor:
    """Return the executor that `spin` uses by default.

    The executor keeps unfinished coroutines until the default context is shut down.
    """
    global _executor
    with _executor_lock:
        context = get_default_context()
        if _executor is None or _executor.context is not context:
            from rclpy.executors import SingleThreadedExecutor

            _executor = SingleThreadedExecutor()
            context.on_shutdown(_reset_executor)
        return _executor


def _reset_executor() -> None:
    global _executor
    with _executor_lock:
        executor, _executor = _executor, None
    if executor is not None:
        executor.shutdown()


def shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut a context down.

    Args:
        context: context to shut down. [default: the default context, which a new context replaces]
        uninstall_handlers: restore the signal handlers from before `init`. [default: for the default context only]

    Raises:
        RuntimeError: the context was never opened, or is shut down already.
    """
    explicit = explicit_context(context)
    is_default = explicit is None or explicit is get_default_context()
    _shutdown(context=explicit)
    if uninstall_handlers or (uninstall_handlers is None and is_default):
        uninstall_signal_handlers()


def try_shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut a context down if it is open.

    Args:
        context: context to shut down. [default: the default context, which a new context replaces]
        uninstall_handlers: restore the signal handlers from before `init`; None does so for the default context, if it
            was open.
    """
    explicit = explicit_context(context)
    is_default = explicit is None or explicit is get_default_context()
    was_open = ok(context=explicit)
    _try_shutdown(context=explicit)
    if uninstall_handlers or (uninstall_handlers is None and is_default and was_open):
        uninstall_signal_handlers()


def create_node(
    node_name: str,
    *,
    context: Context | None = None,
    cli_args: list[str] | None = None,
    namespace: str | None = None,
    use_global_arguments: bool = True,
    enable_rosout: bool = True,
    rosout_qos_profile: QoSProfile | int = qos_profile_rosout_default,
    start_parameter_services: bool = True,
    parameter_overrides: list[Parameter] | None = None,
    allow_undeclared_parameters: bool = False,
    automatically_declare_parameters_from_overrides: bool = False,
    enable_logger_service: bool = False,
) -> Node:
    """Create a `rclpy.node.Node`, whose constructor takes the same arguments."""
    arguments = locals().copy()
    from rclpy.node import Node

    return Node(**arguments)


def spin_once(node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None) -> None:
    """Run one ready callback of a node; wait for one if none is ready.

    Args:
        node: node whose callbacks run.
        executor: executor to use. [default: the global executor]
        timeout_sec: maximum time to wait; None or negative: unlimited; 0: do not wait.
    """
    executor = get_global_executor() if executor is None else executor
    was_added = False
    try:
        was_added = executor.add_node(node)
        executor.spin_once(timeout_sec=timeout_sec)
    finally:
        if was_added:
            executor.remove_node(node)


def spin(node: Node, executor: Executor | None = None) -> None:
    """Run the callbacks of a node until the context is shut down.

    Args:
        node: node whose callbacks run.
        executor: executor to use. [default: the global executor]

    Raises:
        ExternalShutdownException: something else than the program shut the context down, for example a signal.
    """
    executor = get_global_executor() if executor is None else executor
    try:
        executor.add_node(node)
        while executor.context.ok():
            executor.spin_once()
    finally:
        executor.remove_node(node)


def spin_until_future_complete(
    node: Node, future: Future[Any], executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Run the callbacks of a node until a future is done or `timeout_sec` has passed."""
    executor = get_global_executor() if executor is None else executor
    was_added = False
    try:
        was_added = executor.add_node(node)
        executor.spin_until_future_complete(future, timeout_sec)
    finally:
        if was_added:
            executor.remove_node(node)
