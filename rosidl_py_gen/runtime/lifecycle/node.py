"""The managed node: a `Node` with the state machine of `machine.py`.

Decides nothing but the order in which the two come up.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.lifecycle.machine import NodeLifecycle
from rosidl_py_gen.runtime.node.node import Node

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.runtime.node.context import Context


class LifecycleNode(NodeLifecycle, Node):
    """A node that others configure, activate and shut down (protocol.md 12.2).

    Override `on_configure`, `on_activate` and so on; create endpoints in `on_configure`. Arguments are those of `Node`.
    """

    def __init__(
        self,
        name: str,
        namespace: str = "",
        *,
        context: Context | None = None,
        enable_rosout: bool = True,
        overrides: Mapping[str, object] | None = None,
        allow_undeclared: bool = False,
        declare_overrides: bool = False,
        start_services: bool = True,
        logger_services: bool = False,
    ) -> None:
        super().__init__(
            name,
            namespace,
            context=context,
            enable_rosout=enable_rosout,
            overrides=overrides,
            allow_undeclared=allow_undeclared,
            declare_overrides=declare_overrides,
            start_services=start_services,
            logger_services=logger_services,
        )
        try:
            self._open_lifecycle()
        except BaseException:
            self.close()
            raise
