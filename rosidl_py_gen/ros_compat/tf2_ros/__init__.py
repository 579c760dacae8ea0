"""Transforms between coordinate frames: buffer, listener, broadcasters and client."""

import rclpy as rclpy
from geometry_msgs.msg import PointStamped as PointStamped
from geometry_msgs.msg import PoseStamped as PoseStamped
from geometry_msgs.msg import PoseWithCovarianceStamped as PoseWithCovarianceStamped
from geometry_msgs.msg import TransformStamped as TransformStamped
from geometry_msgs.msg import Vector3Stamped as Vector3Stamped
from rclpy.action.client import ActionClient as ActionClient
from rclpy.callback_groups import ReentrantCallbackGroup as ReentrantCallbackGroup
from rclpy.clock import Clock as Clock
from rclpy.clock import JumpThreshold as JumpThreshold
from rclpy.clock import TimeJump as TimeJump
from rclpy.duration import Duration as Duration
from rclpy.executors import SingleThreadedExecutor as SingleThreadedExecutor
from rclpy.node import Node as Node
from rclpy.qos import DurabilityPolicy as DurabilityPolicy
from rclpy.qos import HistoryPolicy as HistoryPolicy
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.task import Future as Future
from rclpy.time import Time as Time
from sensor_msgs.msg import PointCloud2 as PointCloud2
from std_msgs.msg import Header as Header
from tf2_msgs.action import LookupTransform as LookupTransform
from tf2_msgs.msg import TFMessage as TFMessage
from tf2_msgs.srv import FrameGraph as FrameGraph
from tf2_py import BufferCore as BufferCore
from tf2_py import ConnectivityException as ConnectivityException
from tf2_py import ExtrapolationException as ExtrapolationException
from tf2_py import InvalidArgumentException as InvalidArgumentException
from tf2_py import LookupException as LookupException
from tf2_py import TimeoutException as TimeoutException
from tf2_py import TransformException as TransformException

from tf2_ros.buffer import Buffer as Buffer
from tf2_ros.buffer_client import BufferClient as BufferClient
from tf2_ros.buffer_interface import BufferInterface as BufferInterface
from tf2_ros.buffer_interface import ConvertRegistration as ConvertRegistration
from tf2_ros.buffer_interface import NotImplementedException as NotImplementedException
from tf2_ros.buffer_interface import Stamped as Stamped
from tf2_ros.buffer_interface import TransformRegistration as TransformRegistration
from tf2_ros.buffer_interface import TypeException as TypeException
from tf2_ros.buffer_interface import convert as convert
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster as StaticTransformBroadcaster
from tf2_ros.transform_broadcaster import TransformBroadcaster as TransformBroadcaster
from tf2_ros.transform_listener import TransformListener as TransformListener
