"""Module of tf2_ros with the broadcaster of static transforms."""

from tf2_ros.transform_broadcaster import StaticTransformBroadcaster, TransformStamped
