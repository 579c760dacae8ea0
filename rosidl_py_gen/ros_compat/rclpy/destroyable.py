"""Protocol of objects that are destroyed when no longer in use; `rclpy.handles` implements it."""

from types import TracebackType
from typing import Optional, Protocol, Type


class DestroyableType(Protocol):
    """Object that is destroyed when it is no longer in use."""

    def __enter__(self) -> object: ...
    def __exit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exctb: TracebackType | None
    ) -> None: ...
    def destroy_when_not_in_use(self) -> None:
        """Refuse new uses, and destroy the object after the last current one."""
