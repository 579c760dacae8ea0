"""Common base of the classes from which `Node` inherits its methods."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.node.context import Context
    from rosidl_py_gen.runtime.time.clock import Clock


class NodeBase:
    """Base class that declares the attributes which all methods of `Node` use.

    The constructor of `Node` sets the attributes.
    """

    _scope: EntityScope
    _names: NodeNames
    context: Context
    clock: Clock

    def _require_open(self) -> None:
        self._scope.require_open(False, "the node")
        self.context._core.loop_binding.adopt_running_loop()
