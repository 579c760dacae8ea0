"""Transforms between coordinate frames: buffer, listener and broadcasters."""

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
