"""Waitables: objects of a program for which an executor waits, and which it executes."""

from __future__ import annotations

from functools import partialmethod
from typing import TYPE_CHECKING, Any

from rclpy._classes import Subscriptable

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rclpy.callback_groups import CallbackGroup
    from rclpy.executors import Executor
    from rclpy.handles import Destroyable
    from rclpy.task import Future


class NumberOfEntities:
    """Number of entities of each kind that a waitable adds to a wait set."""

    __slots__ = ["num_clients", "num_events", "num_guard_conditions", "num_services", "num_subscriptions", "num_timers"]

    def __init__(
        self,
        num_subs: int = 0,
        num_gcs: int = 0,
        num_timers: int = 0,
        num_clients: int = 0,
        num_services: int = 0,
        num_events: int = 0,
    ) -> None:
        self.num_subscriptions = num_subs
        self.num_guard_conditions = num_gcs
        self.num_timers = num_timers
        self.num_clients = num_clients
        self.num_services = num_services
        self.num_events = num_events

    def _rosidl_numbers(self) -> tuple[int, int, int, int, int, int]:
        return (
            self.num_subscriptions,
            self.num_guard_conditions,
            self.num_timers,
            self.num_clients,
            self.num_services,
            self.num_events,
        )

    def __add__(self, other: NumberOfEntities) -> NumberOfEntities:
        return type(self)(*[a + b for a, b in zip(self._rosidl_numbers(), other._rosidl_numbers(), strict=True)])

    def __repr__(self) -> str:
        return f"<{type(self).__name__}({', '.join(map(str, self._rosidl_numbers()))})>"


class WaitSet:
    """Set of the handles that waitables have added, which is asked after a wait if each of them is ready."""

    def __init__(self) -> None:
        self._handles: dict[str, list[Any]] = {}
        self._ready: dict[tuple[str, int], bool] = {}

    def _add(self, kind: str, handle: Destroyable) -> int:
        handles = self._handles.setdefault(kind, [])
        handles.append(handle)
        return len(handles) - 1

    add_subscription = partialmethod(_add, "subscription")
    """Add a handle to the wait set, and return its index for `is_ready`. Methods for the other kinds of handles do the
    same."""
    add_guard_condition = partialmethod(_add, "guard_condition")
    add_timer = partialmethod(_add, "timer")
    add_client = partialmethod(_add, "client")
    add_service = partialmethod(_add, "service")
    add_event = partialmethod(_add, "event")

    def is_ready(self, entity_type: str, index: int) -> bool:
        """Return True if the handle with an index, of a kind such as ``"subscription"``, is ready."""
        key = entity_type, index
        if key not in self._ready:
            handle = self._handles[entity_type][index]
            self._ready[key] = ready = handle.is_ready()
            if ready and entity_type == "guard_condition":  # waiting takes a trigger
                handle.take_trigger()
        return self._ready[key]

    def get_ready_entities(self, entity_type: str) -> list[int]:
        """Return the numbers (`pointer`) that identify the ready handles of a kind."""
        handles = self._handles.get(entity_type, [])
        return [handle.pointer for index, handle in enumerate(handles) if self.is_ready(entity_type, index)]


class Waitable(Subscriptable):
    """Base class of objects that an executor waits for and executes."""

    rosidl_queue: Collection[Any] | None = None
    """Queue of arrivals of the waitable. While the queue is empty, the waitable is not ready and `is_ready` is not
    called. None without a queue."""

    rosidl_take_method = "_take_waitable"

    def __init__(self, callback_group: CallbackGroup) -> None:
        self.callback_group = callback_group
        self.callback_group.add_entity(self)
        self._executor_event = False
        self._futures: list[Future[Any]] = []

    def __enter__(self) -> None:
        """Prevent the entities of the waitable from being destroyed during a wait."""

    def __exit__(self, t: object, v: object, tb: object) -> None:
        """Allow the entities of the waitable to be destroyed again."""

    def rosidl_take(self, executor: Executor) -> Callable[[], Any]:
        data = self.take_data()

        async def execute() -> None:
            for future in self._futures:
                future._set_executor(executor)
            await self.execute(data)

        return execute

    def add_future(self, future: Future[Any]) -> None:
        """Make the waitable's executor call the done callbacks of a future."""
        self._futures.append(future)

    def remove_future(self, future: Future[Any]) -> None:
        self._futures.remove(future)

    def is_ready(self, wait_set: WaitSet) -> bool:
        """Return True if `take_data` would return something."""
        raise NotImplementedError("Must be implemented by subclass")

    def take_data(self) -> Any:
        """Return the data to process, so that the waitable is no longer ready."""
        raise NotImplementedError("Must be implemented by subclass")

    async def execute(self, taken_data: Any) -> None:
        """Process the data that `take_data` returned."""
        raise NotImplementedError("Must be implemented by subclass")

    def get_num_entities(self) -> NumberOfEntities:
        """Return the number of entities that the waitable adds to a wait set."""
        raise NotImplementedError("Must be implemented by subclass")

    def add_to_wait_set(self, wait_set: WaitSet) -> None:
        """Add the handles of the waitable's entities to a wait set."""
        raise NotImplementedError("Must be implemented by subclass")
