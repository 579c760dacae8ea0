"""The action methods of a node.

Decides names and defaults as ROS users know them; what the endpoints do is in their own files, which are imported when
they are first used: most nodes have no actions, and every node has to start fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, overload

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.argument_checks import Policy
    from rosidl_py_gen.runtime.actions.client import ActionClient
    from rosidl_py_gen.runtime.actions.server import ActionServer
    from rosidl_py_gen.runtime.actions.server_goal import GoalResult, ServerGoal
    from rosidl_py_gen.runtime.actions.types import ActionClass, ActionT, FeedbackT, GoalT, ResultT, UntypedAction
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import DictMessage
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.node.context import Context
    from rosidl_py_gen.runtime.time.clock import Clock

RESULT_TIMEOUT_S = 900.0
"""rclpy's default."""


class ActionMethods:
    """Action methods of `Node`."""

    _scope: EntityScope
    context: Context
    clock: Clock
    _names: NodeNames

    @overload
    def create_action_server(
        self,
        action: ActionClass[ActionT, GoalT, ResultT, FeedbackT],
        name: str,
        execute: Callable[[ServerGoal[ActionT]], ResultT | GoalResult | Awaitable[ResultT | GoalResult | None] | None]
        | None = None,
        *,
        goal_callback: Callable[[GoalT], object] | None = None,
        cancel_callback: Callable[[ServerGoal[ActionT]], object] | bool = True,
        result_timeout_s: float = RESULT_TIMEOUT_S,
        goal_policy: Policy = "parallel",
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[ActionT]: ...
    @overload
    def create_action_server(
        self,
        action: str,
        name: str,
        execute: Callable[
            [ServerGoal[UntypedAction]], DictMessage | GoalResult | Awaitable[DictMessage | GoalResult | None] | None
        ]
        | None = None,
        *,
        goal_callback: Callable[[DictMessage], object] | None = None,
        cancel_callback: Callable[[ServerGoal[UntypedAction]], object] | bool = True,
        result_timeout_s: float = RESULT_TIMEOUT_S,
        goal_policy: Policy = "parallel",
        type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[UntypedAction]: ...
    def create_action_server(
        self,
        action: object,
        name: str,
        execute: Callable[[ServerGoal[Any]], Any] | None = None,
        *,
        goal_callback: Callable[[Any], object] | None = None,
        cancel_callback: Callable[[ServerGoal[Any]], object] | bool = True,
        result_timeout_s: float = RESULT_TIMEOUT_S,
        goal_policy: Policy = "parallel",
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[Any]:
        """Serve an action; callbacks may be plain or async. Without `execute`, iterate over the goal requests.

        Args:
            execute: gets a `ServerGoal` and returns the result (SUCCEEDED), or ends the goal itself with `succeed`,
                `abort` or `canceled`, which get the result or leave it to what it returns. An exception, or returning
                None without having ended it, is ABORTED. A plain function runs in a thread of its own for each goal;
                it has to look at `goal.is_cancel_requested`, which is also true when the node closes.
            goal_callback: gets the goal; answers a `GoalDecision` (DEFER: `goal.execute()` later), or a true value
                or None to accept, and another false value to reject.
            cancel_callback: True accepts every cancel, False refuses; a function gets the `ServerGoal`, and a false
                value other than None refuses. A handler that does not read `goal.is_cancel_requested` runs to its end.
            result_timeout_s: how long a result is kept after the end of its goal; `math.inf` for ever.
            goal_policy: ``"parallel"`` runs any number of goals at once. One at a time: ``"reject"`` refuses others
                meanwhile, ``"queue"`` lets them wait their turn, ``"preempt"`` cancels the running one for the newest.
                Deferred goals take their place in the queue when `execute` is called; `goal.started()` waits for it.
            arrays: sequences of fixed-size messages in goals are structured arrays, as in `decode`.
            type_hash_check: that of `Node`, for the services and topics of this action.

        Goals that have not started (queued, or deferred) end as CANCELED when a cancel is accepted.

        Raises:
            InvalidNameError, TypeNotFoundError, ClosedError: as their names say.
            TypeError, ActionArgumentError, ValueError: an argument is of no use, or `goal_callback` comes without
                `execute`.
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
        self,
        action: type[ActionT],
        name: str,
        *,
        feedback_depth: int = 100,
        server_lost_timeout_s: float = 5.0,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionClient[ActionT]: ...
    @overload
    def create_action_client(
        self,
        action: str,
        name: str,
        *,
        feedback_depth: int = 100,
        server_lost_timeout_s: float = 5.0,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionClient[UntypedAction]: ...
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
        """Send goals to an action. A type given as text makes goals, results and feedback dicts.

        Args:
            feedback_depth: how many feedback messages a goal keeps until somebody iterates, at least 1; older ones are
                dropped, and counted in `goal.feedback_dropped`.
            server_lost_timeout_s: how long a server may be away before goals end with `ActionServerLostError`;
                `math.inf` for ever.
            arrays: sequences of fixed-size messages in results and feedback are structured arrays, as in `decode`.
            type_hash_check: that of `Node`, for the services and topics of this action.

        Raises:
            InvalidNameError, TypeNotFoundError, ClosedError. TypeError, ActionArgumentError: an argument is of no use.
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
