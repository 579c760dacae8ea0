"""Common base of the classes from which `Node` inherits its methods, and the options of a node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.node.arguments import RosArguments

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.node.context import Context
    from rosidl_py_gen.runtime.time.clock import Clock


class NodeBase:
    """Attributes that all methods of `Node` use; its constructor sets them."""

    _scope: EntityScope
    _names: NodeNames
    context: Context
    clock: Clock

    def _require_open(self) -> None:
        self._scope.require_open(False, "the node")
        self.context._core.loop_binding.adopt_running_loop()


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeOptions:
    """Keyword arguments of `Node`; `arguments` are its parsed ``cli_args``."""

    arguments: RosArguments
    use_global_arguments: bool
    enable_rosout: bool
    parameter_overrides: Mapping[str, object] | None
    allow_undeclared_parameters: bool
    automatically_declare_parameters_from_overrides: bool
    start_services: bool
    parameter_events: bool
    logger_services: bool
    time_source: bool
