"""Broadcaster of static transforms."""

from tf2_ros.transform_broadcaster import StaticTransformBroadcaster, TransformStamped
