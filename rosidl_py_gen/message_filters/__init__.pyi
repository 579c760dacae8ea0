from rosidl_py_gen.message_filters.filters import ApproximateTimeSynchronizer as ApproximateTimeSynchronizer
from rosidl_py_gen.message_filters.filters import Cache as Cache
from rosidl_py_gen.message_filters.filters import MessageFilter as MessageFilter
from rosidl_py_gen.message_filters.filters import StampError as StampError
from rosidl_py_gen.message_filters.filters import Subscriber as Subscriber
from rosidl_py_gen.message_filters.filters import TimeSynchronizer as TimeSynchronizer

# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.message_filters.filters import NoNodeScope as NoNodeScope
from rosidl_py_gen.message_filters.filters import call_all as call_all
