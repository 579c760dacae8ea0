"""Point clouds in other frames; importing it makes ``Buffer.transform`` take them."""

from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud, transform_points

__all__ = ["do_transform_cloud", "transform_points"]
