"""Transformation of geometry_msgs; importing the package registers the types for ``Buffer.transform``."""

import tf2_ros

from tf2_geometry_msgs.tf2_geometry_msgs import *
