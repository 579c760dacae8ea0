"""Service and action methods of a node: names and defaults as in rclpy.

Action clients and servers are imported when they are first used, because most nodes have none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, overload

from rosidl_py_gen.cdr import Message, Service
from rosidl_py_gen.runtime.entities.client import Client
from rosidl_py_gen.runtime.entities.message_types import DictMessage, service_type
from rosidl_py_gen.runtime.entities.server import ServiceServer
from rosidl_py_gen.runtime.node.node_base import NodeBase
from rosidl_py_gen.runtime.transport.qos import as_profile

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.client import ActionClient
    from rosidl_py_gen.runtime.actions.server import ActionServer
    from rosidl_py_gen.runtime.actions.server_goal import GoalResult, ServerGoal
    from rosidl_py_gen.runtime.actions.types import (
        ActionClass,
        ActionT,
        FeedbackT,
        GoalT,
        Policy,
        ResultT,
        UntypedAction,
    )
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.qos import QoSLike

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)


class ServiceMethods(NodeBase):
    """Service and action methods of `Node`."""

    @overload
    def create_service(
        self, srv_type: type[Service[RequestT, ResponseT]], name: str,
        handler: Callable[[RequestT], ResponseT | Awaitable[ResponseT]] | None = None, qos: QoSLike = 10, *,
        arrays: bool = False, type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[RequestT, ResponseT]: ...  # fmt: skip
    @overload
    def create_service(
        self, srv_type: str, name: str,
        handler: Callable[[DictMessage], DictMessage | Awaitable[DictMessage]] | None = None, qos: QoSLike = 10, *,
        type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[DictMessage, DictMessage]: ...  # fmt: skip
    def create_service(
        self,
        srv_type: type[Service[Any, Any]] | str,
        name: str,
        handler: Callable[[Any], Any] | None = None,
        qos: QoSLike = 10,
        *,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[Any, Any]:
        """Create a server of a service.

        Args:
            srv_type: service class, or its name such as ``"std_srvs/srv/Trigger"``: then messages are dicts.
            name: service name, which is expanded and remapped.
            handler: plain or async function that gets the request and returns the response; None to iterate or `take`.
            qos: profile, or depth.
            arrays: decode sequences of fixed-size messages as structured arrays; not with a type name.
            type_hash_check: like `type_hash_check` of `Node`.

        Raises:
            InvalidNameError: the name is invalid.
            InvalidQoSError: the profile is invalid.
            TypeNotFoundError: `srv_type` names no known type.
            CallbackSignatureError: `handler` cannot be called with a request.
            TypeError, ValueError: an argument is invalid.
            ClosedError: the node is closed.
        """
        self._require_open()
        server: ServiceServer[Any, Any] = ServiceServer(
            self._scope,
            service_type(srv_type, arrays=arrays),
            self._names.resolve_service(name),
            handler,
            as_profile(qos),
            type_hash_check=type_hash_check,
        )
        if handler is not None:
            self._scope.with_callbacks[id(server)] = server
        return server

    @overload
    def create_client(
        self, srv_type: type[Service[RequestT, ResponseT]], name: str, qos: QoSLike = 10, *, arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> Client[RequestT, ResponseT]: ...  # fmt: skip
    @overload
    def create_client(
        self, srv_type: str, name: str, qos: QoSLike = 10, *, type_hash_check: TypeCheck | None = None
    ) -> Client[DictMessage, DictMessage]: ...
    def create_client(
        self,
        srv_type: type[Service[Any, Any]] | str,
        name: str,
        qos: QoSLike = 10,
        *,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> Client[Any, Any]:
        """Create a client of a service.

        Args:
            srv_type: service class, or its name such as ``"std_srvs/srv/Trigger"``: then messages are dicts.
            name: service name, which is expanded and remapped.
            qos: profile, or depth.
            arrays: decode sequences of fixed-size messages as structured arrays; not with a type name.
            type_hash_check: like `type_hash_check` of `Node`.

        Raises:
            InvalidNameError: the name is invalid.
            InvalidQoSError: the profile is invalid.
            TypeNotFoundError: `srv_type` names no known type.
            TypeError, ValueError: an argument is invalid.
            ClosedError: the node is closed.
        """
        self._require_open()
        return Client(
            self._scope,
            service_type(srv_type, arrays=arrays),
            self._names.resolve_service(name),
            as_profile(qos),
            type_hash_check=type_hash_check,
        )

    @overload
    def create_action_server(
        self, action: ActionClass[ActionT, GoalT, ResultT, FeedbackT], name: str,
        execute: Callable[[ServerGoal[ActionT]], ResultT | GoalResult | Awaitable[ResultT | GoalResult | None] | None]
        | None = None, *, goal_callback: Callable[[GoalT], object] | None = None,
        cancel_callback: Callable[[ServerGoal[ActionT]], object] | bool = True, result_timeout_s: float = 900.0,
        goal_policy: Policy = "parallel", arrays: bool = False, type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[ActionT]: ...  # fmt: skip
    @overload
    def create_action_server(
        self, action: str, name: str,
        execute: Callable[
            [ServerGoal[UntypedAction]], DictMessage | GoalResult | Awaitable[DictMessage | GoalResult | None] | None
        ] | None = None, *, goal_callback: Callable[[DictMessage], object] | None = None,
        cancel_callback: Callable[[ServerGoal[UntypedAction]], object] | bool = True, result_timeout_s: float = 900.0,
        goal_policy: Policy = "parallel", type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[UntypedAction]: ...  # fmt: skip
    def create_action_server(
        self,
        action: object,
        name: str,
        execute: Callable[[ServerGoal[Any]], Any] | None = None,
        *,
        goal_callback: Callable[[Any], object] | None = None,
        cancel_callback: Callable[[ServerGoal[Any]], object] | bool = True,
        result_timeout_s: float = 900.0,
        goal_policy: Policy = "parallel",
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[Any]:
        """Create a server of an action; callbacks may be plain or async functions.

        Goals that have not started (queued, or deferred) end as CANCELED when a cancel request is accepted.

        Args:
            action: action class, or its name: then goals, results and feedback are dicts.
            name: action name, which is expanded and remapped.
            execute: gets a `ServerGoal` and returns the result (SUCCEEDED), or ends the goal with `succeed`, `abort` or
                `canceled`, with the result as argument or as return value. An exception, or returning None without
                having ended the goal, is ABORTED. A plain function runs in a thread for each goal; it must check
                `goal.is_cancel_requested`, which is also true when the node closes. None: iterate over the requests.
            goal_callback: gets the goal; returns a `GoalDecision` (DEFER: `goal.execute()` later), or a true value or
                None to accept, another false value to reject.
            cancel_callback: True accepts every cancel request, False refuses; a function gets the `ServerGoal`, and
                refuses with a false value other than None. A handler that does not check `goal.is_cancel_requested`
                runs to its end.
            result_timeout_s: time for which a result is retained after the end of its goal, or after `execute` returns
                the result of a goal that it has ended before; `math.inf` forever.
            goal_policy: ``"parallel"`` runs all goals concurrently. The others run one goal at a time: ``"reject"``
                rejects further ones, ``"queue"`` runs them later, ``"preempt"`` cancels the running one. A deferred
                goal is queued when `execute` is called; `goal.started()` waits for its start.
            arrays: decode sequences of fixed-size messages in goals as structured arrays; not with a type name.
            type_hash_check: like `type_hash_check` of `Node`, for the services and topics of this action.

        Raises:
            InvalidNameError: the action name is invalid.
            TypeNotFoundError: `action` names no known type.
            TypeError, ActionArgumentError, ValueError: an argument is invalid, or `goal_callback` is given without
                `execute`.
            ClosedError: the node is closed.
        """
        from rosidl_py_gen.runtime.actions.server import ActionServer
        from rosidl_py_gen.runtime.actions.types import ActionNames, action_type

        self._scope.require_open(False, "the node")
        server: ActionServer[Any] = ActionServer(
            self._scope,
            self.clock,
            action_type(action, arrays=arrays),
            ActionNames.resolve(self._names, name),
            execute,
            goal_callback=goal_callback,
            cancel_callback=cancel_callback,
            result_timeout_s=result_timeout_s,
            goal_policy=goal_policy,
            type_hash_check=type_hash_check,
        )
        if execute is not None:
            self._scope.with_callbacks[id(server)] = server
        return server

    @overload
    def create_action_client(
        self, action: type[ActionT], name: str, *, feedback_depth: int = 100, server_lost_timeout_s: float = 5.0,
        arrays: bool = False, type_hash_check: TypeCheck | None = None,
    ) -> ActionClient[ActionT]: ...  # fmt: skip
    @overload
    def create_action_client(
        self, action: str, name: str, *, feedback_depth: int = 100, server_lost_timeout_s: float = 5.0,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionClient[UntypedAction]: ...  # fmt: skip
    def create_action_client(
        self,
        action: type[Action[Any, Any, Any]] | str,
        name: str,
        *,
        feedback_depth: int = 100,
        server_lost_timeout_s: float = 5.0,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionClient[Any]:
        """Create a client of an action.

        Args:
            action: action class, or its name: then goals, results and feedback are dicts.
            name: action name, which is expanded and remapped.
            feedback_depth: number of feedback messages that a goal retains for iteration, at least 1; older ones are
                dropped, and counted in `goal.feedback_dropped`.
            server_lost_timeout_s: time without server after which goals end with `ActionServerLostError`; `math.inf`
                forever.
            arrays: decode sequences of fixed-size messages in results and feedback as structured arrays.
            type_hash_check: like `type_hash_check` of `Node`, for the services and topics of this action.

        Raises:
            InvalidNameError: the action name is invalid.
            TypeNotFoundError: `action` names no known type.
            TypeError, ActionArgumentError, ValueError: an argument is invalid.
            ClosedError: the node is closed.
        """
        from rosidl_py_gen.runtime.actions.client import ActionClient
        from rosidl_py_gen.runtime.actions.types import ActionNames, action_type

        self._scope.require_open(False, "the node")
        return ActionClient(
            self._scope,
            action_type(action, arrays=arrays),
            ActionNames.resolve(self._names, name),
            feedback_depth=feedback_depth,
            server_lost_timeout_s=server_lost_timeout_s,
            type_hash_check=type_hash_check,
        )
