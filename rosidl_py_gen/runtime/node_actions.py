"""The action methods of a node.

Decides names and defaults as ROS users know them; what the endpoints do is in their own files, which are imported when
they are first used: most nodes have no actions, and every node has to start fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, overload

from rosidl_py_gen.cdr import Action, Message
from rosidl_py_gen.runtime.message_types import Untyped

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.action_client import ActionClient
    from rosidl_py_gen.runtime.action_goal import ServerGoal
    from rosidl_py_gen.runtime.action_server import ActionServer, Policy
    from rosidl_py_gen.runtime.clock import Clock
    from rosidl_py_gen.runtime.context import Context
    from rosidl_py_gen.runtime.remap_rules import NodeNames
    from rosidl_py_gen.runtime.scope import Scope

GoalT = TypeVar("GoalT", bound=Message)
ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)

RESULT_TIMEOUT_S = 900.0
"""rclpy's default."""


class NodeActions:
    """Action methods of `Node`."""

    scope: Scope
    context: Context
    clock: Clock
    _closed: bool
    _names: NodeNames

    @overload
    def create_action_server(
        self,
        action: type[Action[GoalT, ResultT, FeedbackT]],
        name: str,
        execute: Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], object] | None = None,
        *,
        accept: Callable[[GoalT], object] | None = None,
        on_cancel: Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], object] | None = None,
        result_timeout_s: float = RESULT_TIMEOUT_S,
        policy: Policy = "parallel",
    ) -> ActionServer[GoalT, ResultT, FeedbackT]: ...
    @overload
    def create_action_server(
        self,
        action: str,
        name: str,
        execute: Callable[[ServerGoal[Untyped, Untyped, Untyped]], object] | None = None,
        *,
        accept: Callable[[Untyped], object] | None = None,
        on_cancel: Callable[[ServerGoal[Untyped, Untyped, Untyped]], object] | None = None,
        result_timeout_s: float = RESULT_TIMEOUT_S,
        policy: Policy = "parallel",
    ) -> ActionServer[Untyped, Untyped, Untyped]: ...
    def create_action_server(
        self,
        action: type[Action[Any, Any, Any]] | str,
        name: str,
        execute: Callable[[ServerGoal[Any, Any, Any]], object] | None = None,
        *,
        accept: Callable[[Any], object] | None = None,
        on_cancel: Callable[[ServerGoal[Any, Any, Any]], object] | None = None,
        result_timeout_s: float = RESULT_TIMEOUT_S,
        policy: Policy = "parallel",
    ) -> ActionServer[Any, Any, Any]:
        """Serve an action; callbacks may be plain or async. Without `execute`, iterate over the goal requests.

        Args:
            execute: gets a `ServerGoal` and returns the result (SUCCEEDED), or ends the goal itself with `succeed`,
                `abort` or `canceled`. An exception, or returning None without having ended it, is ABORTED.
            accept: gets the goal; answers True or None, False, or a `GoalDecision` (DEFER: `goal.execute()` later).
            on_cancel: gets the `ServerGoal`; False refuses the cancel. For the default see `action_server.py`.
            result_timeout_s: how long a result is kept after the end of its goal.
            policy: ``"parallel"`` runs any number of goals at once. One at a time: ``"reject"`` refuses others
                meanwhile, ``"queue"`` lets them wait their turn, ``"preempt"`` cancels the running one for the newest.

        Raises:
            InvalidNameError, TypeNotFoundError, ClosedError.
        """
        from rosidl_py_gen.runtime.action_server import ActionServer
        from rosidl_py_gen.runtime.action_types import ActionNames, action_type

        self.scope.require_open(self._closed, "the node")
        server: ActionServer[Any, Any, Any] = ActionServer(
            self.scope,
            self.clock,
            action_type(action),
            ActionNames.resolve(self._names, name),
            execute,
            accept=accept,
            on_cancel=on_cancel,
            result_timeout_s=result_timeout_s,
            policy=policy,
        )
        self.scope.own(server)
        return server

    @overload
    def create_action_client(
        self,
        action: type[Action[GoalT, ResultT, FeedbackT]],
        name: str,
        *,
        feedback_depth: int = 100,
        server_lost_after_s: float = 5.0,
    ) -> ActionClient[GoalT, ResultT, FeedbackT]: ...
    @overload
    def create_action_client(
        self, action: str, name: str, *, feedback_depth: int = 100, server_lost_after_s: float = 5.0
    ) -> ActionClient[Untyped, Untyped, Untyped]: ...
    def create_action_client(
        self,
        action: type[Action[Any, Any, Any]] | str,
        name: str,
        *,
        feedback_depth: int = 100,
        server_lost_after_s: float = 5.0,
    ) -> ActionClient[Any, Any, Any]:
        """Send goals to an action. A type given as text makes goals, results and feedback dicts.

        Args:
            feedback_depth: how many feedback messages a goal keeps until somebody iterates; older ones are dropped.
            server_lost_after_s: how long a server may be away before goals end with `ActionServerLost`.

        Raises:
            InvalidNameError, TypeNotFoundError, ClosedError.
        """
        from rosidl_py_gen.runtime.action_client import ActionClient
        from rosidl_py_gen.runtime.action_types import ActionNames, action_type

        self.scope.require_open(self._closed, "the node")
        client: ActionClient[Any, Any, Any] = ActionClient(
            self.scope,
            action_type(action),
            ActionNames.resolve(self._names, name),
            self.context.run_until_complete,
            feedback_depth=feedback_depth,
            server_lost_after_s=server_lost_after_s,
        )
        self.scope.own(client)
        return client
