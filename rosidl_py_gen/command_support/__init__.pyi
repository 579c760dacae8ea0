# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.command_support.command_node import CommandNode as CommandNode
from rosidl_py_gen.command_support.command_node import NetworkOptions as NetworkOptions
from rosidl_py_gen.command_support.command_node import context_opened_early as context_opened_early
from rosidl_py_gen.command_support.command_node import first_of as first_of
from rosidl_py_gen.command_support.errors import CommandError as CommandError
from rosidl_py_gen.command_support.errors import report as report
from rosidl_py_gen.command_support.graph_lookup import interface_class as interface_class
from rosidl_py_gen.command_support.graph_lookup import opaque_class as opaque_class
from rosidl_py_gen.command_support.graph_lookup import preload_while_waiting as preload_while_waiting
from rosidl_py_gen.command_support.graph_lookup import require_stamp as require_stamp
from rosidl_py_gen.command_support.self_test_process import run_self_test_peer as run_self_test_peer
