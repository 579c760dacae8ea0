"""The managed node: a `Node` with the state machine of `lifecycle.py`, which comes up last."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.lifecycle.machine import NodeLifecycle
from rosidl_py_gen.runtime.node.node import Node

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.node.options import NodeOptions


class LifecycleNode(NodeLifecycle, Node):
    """A node that others configure, activate and shut down (protocol.md 12.2).

    Override `on_configure`, `on_activate` and so on; create endpoints in `on_configure`. Arguments are those of `Node`.
    """

    def _open(self, options: NodeOptions) -> None:
        super()._open(options)
        self._open_lifecycle()
