from rosidl_py_gen.numpy.common import ConversionError as ConversionError
from rosidl_py_gen.numpy.images import array_to_compressedimage as array_to_compressedimage
from rosidl_py_gen.numpy.images import array_to_image as array_to_image
from rosidl_py_gen.numpy.images import compressedimage_to_array as compressedimage_to_array
from rosidl_py_gen.numpy.images import convert_pixels as convert_pixels
from rosidl_py_gen.numpy.images import image_to_array as image_to_array
from rosidl_py_gen.numpy.notebook import load_ipython_extension as load_ipython_extension
from rosidl_py_gen.numpy.points import array_to_occupancygrid as array_to_occupancygrid
from rosidl_py_gen.numpy.points import array_to_pointcloud as array_to_pointcloud
from rosidl_py_gen.numpy.points import laserscan_to_points as laserscan_to_points
from rosidl_py_gen.numpy.points import occupancygrid_to_array as occupancygrid_to_array
from rosidl_py_gen.numpy.points import pointcloud_dtype as pointcloud_dtype
from rosidl_py_gen.numpy.points import pointcloud_to_array as pointcloud_to_array
from rosidl_py_gen.numpy.points import points_to_xyz as points_to_xyz
from rosidl_py_gen.numpy.rotations_and_times import datetime_to_time as datetime_to_time
from rosidl_py_gen.numpy.rotations_and_times import duration_to_timedelta as duration_to_timedelta
from rosidl_py_gen.numpy.rotations_and_times import euler_to_quaternion as euler_to_quaternion
from rosidl_py_gen.numpy.rotations_and_times import matrix_to_quaternion as matrix_to_quaternion
from rosidl_py_gen.numpy.rotations_and_times import matrix_to_transform as matrix_to_transform
from rosidl_py_gen.numpy.rotations_and_times import quaternion_to_euler as quaternion_to_euler
from rosidl_py_gen.numpy.rotations_and_times import quaternion_to_matrix as quaternion_to_matrix
from rosidl_py_gen.numpy.rotations_and_times import time_to_datetime as time_to_datetime
from rosidl_py_gen.numpy.rotations_and_times import timedelta_to_duration as timedelta_to_duration
from rosidl_py_gen.numpy.rotations_and_times import transform_to_matrix as transform_to_matrix

# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.numpy.common import M as M
from rosidl_py_gen.numpy.common import flat_bytes as flat_bytes
from rosidl_py_gen.numpy.common import reads_message as reads_message
