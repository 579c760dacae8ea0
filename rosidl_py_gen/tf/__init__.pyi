from rosidl_py_gen.tf.buffer import StaticTransformBroadcaster as StaticTransformBroadcaster
from rosidl_py_gen.tf.buffer import TransformBroadcaster as TransformBroadcaster
from rosidl_py_gen.tf.buffer import TransformBuffer as TransformBuffer
from rosidl_py_gen.tf.buffer import TransformFilter as TransformFilter
from rosidl_py_gen.tf.frame_tree import ConnectivityError as ConnectivityError
from rosidl_py_gen.tf.frame_tree import ExtrapolationError as ExtrapolationError
from rosidl_py_gen.tf.frame_tree import FrameInfo as FrameInfo
from rosidl_py_gen.tf.frame_tree import InvalidTransformError as InvalidTransformError
from rosidl_py_gen.tf.frame_tree import TransformError as TransformError
from rosidl_py_gen.tf.frame_tree import TransformTimeoutError as TransformTimeoutError
from rosidl_py_gen.tf.frame_tree import UnknownFrameError as UnknownFrameError
from rosidl_py_gen.tf.transform import Transform as Transform

# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.tf.frame_tree import Pose as Pose
from rosidl_py_gen.tf.frame_tree import without_slash as without_slash
