"""Publishers of lifecycle nodes."""

from typing import Any, Union

from rclpy.lifecycle.managed_entity import SimpleManagedEntity
from rclpy.publisher import MsgType, Publisher


class LifecyclePublisher(SimpleManagedEntity, Publisher):
    """Publisher that publishes while its node is active and drops messages otherwise."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        SimpleManagedEntity.__init__(self)
        Publisher.__init__(self, *args, **kwargs)

    @SimpleManagedEntity.when_enabled
    def publish(self, msg: Any) -> None:
        Publisher.publish(self, msg)
