"""Protocol of objects that are destroyed when they are no longer in use; `rclpy.handles` implements the protocol."""

from types import TracebackType
from typing import Optional, Protocol, Type


class DestroyableType(Protocol):
    """Object that is destroyed when it is no longer in use."""

    def __enter__(self) -> object: ...
    def __exit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exctb: TracebackType | None
    ) -> None: ...
    def destroy_when_not_in_use(self) -> None:
        """Refuse new uses of the object, and destroy it when the last current use ends."""
