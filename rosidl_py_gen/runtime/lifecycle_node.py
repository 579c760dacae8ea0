"""The managed node: a `Node` with the state machine of `lifecycle.py`.

Decides nothing but the order in which the two come up.
"""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.runtime.lifecycle import NodeLifecycle
from rosidl_py_gen.runtime.node import Node


class LifecycleNode(NodeLifecycle, Node):
    """A node that others configure, activate and shut down (protocol.md 12.2).

    Override `on_configure`, `on_activate` and so on; create endpoints in `on_configure`. Arguments are those of `Node`.
    """

    def __init__(self, name: str, namespace: str = "", **options: Any) -> None:
        super().__init__(name, namespace, **options)
        try:
            self._open_lifecycle()
        except BaseException:
            self.close()
            raise
