"""Errors of goals and cancel requests."""

from __future__ import annotations

from rosidl_py_gen.errors import RosidlError


class ActionError(RosidlError):
    """Base class of errors of goals and cancel requests."""


class UnknownGoalError(ActionError, LookupError):
    """Raised for a goal that the server does not know, or whose result has expired."""


class GoalRejectedError(ActionError):
    """Raised if the server rejects a goal."""


class ActionTimeoutError(ActionError, TimeoutError):
    """Raised if the server does not reply in time; the goal may continue."""


class ActionServerLostError(ActionError):
    """Raised if the server disappears before it replies, or before it sends the result."""


class CancelError(ActionError):
    """Raised if a cancel request fails."""


class CancelRejectedError(CancelError):
    """Raised if the server refuses to cancel."""


class AlreadyTerminatedError(CancelError):
    """Raised if the goal has ended, or is being cancelled already."""
