"""Messages of geometry_msgs in other frames; importing it makes ``Buffer.transform`` take them."""

import tf2_ros as tf2_ros

from tf2_geometry_msgs.tf2_geometry_msgs import *  # noqa: F403
