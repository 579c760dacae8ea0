"""Publishers of transforms."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import encode, get_message
from rosidl_py_gen.runtime import Durability, QoSProfile
from rosidl_py_gen.tf.buffer import DEPTH
from rosidl_py_gen.tf.frame_tree import without_slash
from rosidl_py_gen.tf.transform import Transform

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node


class TransformBroadcaster:
    """Publisher of transforms that change, on ``/tf``."""

    def __init__(self, node: Node) -> None:
        self._cls: Any = get_message("tf2_msgs/msg/TFMessage")
        self._publisher = node.create_publisher(self._cls, "/tf", DEPTH)

    def send(self, transforms: Any) -> None:
        """Publish one or several TransformStamped messages or `Transform` objects; raises `EncodeError` for others."""
        self._publisher.publish(self._cls(transforms=_to_messages(transforms)))


class StaticTransformBroadcaster:
    """Publisher of transforms that do not change, on ``/tf_static``; later subscribers receive them as well."""

    def __init__(self, node: Node) -> None:
        self._cls: Any = get_message("tf2_msgs/msg/TFMessage")
        latched = QoSProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
        self._publisher = node.create_publisher(self._cls, "/tf_static", latched)
        self._sent: dict[str, Any] = {}

    def send(self, transforms: Any) -> None:
        """Publish one or several transforms with all that were sent before; a child frame has only its last one.

        Raises:
            EncodeError: a value is neither a TransformStamped message nor a `Transform`.
        """
        new = _to_messages(transforms)
        encode(self._cls(transforms=new))  # raises if one is not a transform
        sent = self._sent | {without_slash(message.child_frame_id): message for message in new}
        self._publisher.publish(self._cls(transforms=list(sent.values())))
        self._sent = sent


def _to_messages(transforms: Any) -> list[Any]:
    several = transforms if isinstance(transforms, Iterable) else (transforms,)
    return [one.to_message() if isinstance(one, Transform) else one for one in several]
