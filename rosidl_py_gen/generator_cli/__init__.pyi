# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.generator_cli.command_line import HintedUsageError as HintedUsageError
from rosidl_py_gen.generator_cli.command_line import distro as distro
from rosidl_py_gen.generator_cli.command_line import lazy_completion as lazy_completion
from rosidl_py_gen.generator_cli.commands import cli as cli
from rosidl_py_gen.generator_cli.commands import main as main
from rosidl_py_gen.generator_cli.git_revision import clone_origin as clone_origin
from rosidl_py_gen.generator_cli.shells import complete_directories as complete_directories
from rosidl_py_gen.generator_cli.shells import completion_script as completion_script
from rosidl_py_gen.generator_cli.shells import found_items as found_items
from rosidl_py_gen.generator_cli.shells import install_completion as install_completion
