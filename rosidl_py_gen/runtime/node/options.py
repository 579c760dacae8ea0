"""How a node is set up; the words are ROS's. `Node` documents each option."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeOptions:
    """The keyword arguments of `Node`, without the context."""

    enable_rosout: bool
    overrides: Mapping[str, object] | None
    allow_undeclared: bool
    declare_overrides: bool
    start_services: bool
    parameter_events: bool
    logger_services: bool
