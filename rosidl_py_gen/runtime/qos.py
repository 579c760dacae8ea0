"""Named QoS profiles of ROS, to be used as they are or modified: ``SENSOR_DATA.keep_last(1)``.

The profiles that programs use for topics and services can also be imported from `rosidl_py_gen.runtime`.
"""

from rosidl_py_gen.runtime.transport.qos import ACTION_STATUS as ACTION_STATUS
from rosidl_py_gen.runtime.transport.qos import BEST_AVAILABLE as BEST_AVAILABLE
from rosidl_py_gen.runtime.transport.qos import CLOCK as CLOCK
from rosidl_py_gen.runtime.transport.qos import DEFAULT as DEFAULT
from rosidl_py_gen.runtime.transport.qos import ENUMS as ENUMS
from rosidl_py_gen.runtime.transport.qos import INFINITE_NS as INFINITE_NS
from rosidl_py_gen.runtime.transport.qos import PARAMETER_EVENTS as PARAMETER_EVENTS
from rosidl_py_gen.runtime.transport.qos import PARAMETERS as PARAMETERS
from rosidl_py_gen.runtime.transport.qos import PERIODS as PERIODS
from rosidl_py_gen.runtime.transport.qos import POLICIES as POLICIES
from rosidl_py_gen.runtime.transport.qos import ROSOUT as ROSOUT
from rosidl_py_gen.runtime.transport.qos import SENSOR_DATA as SENSOR_DATA
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT as SERVICES_DEFAULT
from rosidl_py_gen.runtime.transport.qos import SYSTEM_DEFAULT as SYSTEM_DEFAULT
