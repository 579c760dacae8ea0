# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.prefix.build import build_prefix as build_prefix
from rosidl_py_gen.prefix.environment import Executable as Executable
from rosidl_py_gen.prefix.environment import make_importable as make_importable
from rosidl_py_gen.prefix.environment import workspaces as workspaces
from rosidl_py_gen.prefix.executables import find_executables as find_executables
from rosidl_py_gen.prefix.launch_files import is_launch_file as is_launch_file
from rosidl_py_gen.prefix.launch_files import start_launch as start_launch
from rosidl_py_gen.prefix.launch_install import install_ros_packages as install_ros_packages
from rosidl_py_gen.prefix.launch_packages import install_note as install_note
from rosidl_py_gen.prefix.package_plan import PackagePlan as PackagePlan
from rosidl_py_gen.prefix.program_environment import set_environment as set_environment
