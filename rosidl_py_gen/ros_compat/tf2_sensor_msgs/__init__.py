"""Transformation of point clouds; importing the package registers the type for ``Buffer.transform``."""

from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud, transform_points
