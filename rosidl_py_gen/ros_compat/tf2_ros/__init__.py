"""Transforms between coordinate frames: buffer, listener, broadcasters and client."""

import rclpy
from tf2_py import *

from tf2_ros.buffer import *
from tf2_ros.buffer_client import *
from tf2_ros.buffer_interface import *
from tf2_ros.transform_broadcaster import *
from tf2_ros.transform_listener import *
