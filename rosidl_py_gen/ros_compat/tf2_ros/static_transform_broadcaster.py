"""Module with tf2_ros's name for the broadcaster of static transforms, which `transform_broadcaster` defines."""

from tf2_ros.transform_broadcaster import StaticTransformBroadcaster, TransformStamped
