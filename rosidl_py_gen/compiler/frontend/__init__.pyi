# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.compiler.frontend.bag_text_reader import registry_from_text as registry_from_text
from rosidl_py_gen.compiler.frontend.bundled import bundled_packages as bundled_packages
from rosidl_py_gen.compiler.frontend.bundled import changed_interfaces as changed_interfaces
from rosidl_py_gen.compiler.frontend.cmake_reader import UNKNOWN as UNKNOWN
from rosidl_py_gen.compiler.frontend.cmake_reader import CMakeScript as CMakeScript
from rosidl_py_gen.compiler.frontend.cmake_reader import inside as inside
from rosidl_py_gen.compiler.frontend.definition_text import DefinitionText as DefinitionText
from rosidl_py_gen.compiler.frontend.literal_values import LiteralProblem as LiteralProblem
from rosidl_py_gen.compiler.frontend.literal_values import file_scalar as file_scalar
from rosidl_py_gen.compiler.frontend.literal_values import split_strings as split_strings
from rosidl_py_gen.compiler.frontend.model import CONSTANT_NAME as CONSTANT_NAME
from rosidl_py_gen.compiler.frontend.model import ConstantDef as ConstantDef
from rosidl_py_gen.compiler.frontend.model import FieldDef as FieldDef
from rosidl_py_gen.compiler.frontend.model import MessageDef as MessageDef
from rosidl_py_gen.compiler.frontend.model import is_interface_name as is_interface_name
from rosidl_py_gen.compiler.frontend.package_files import BudgetError as BudgetError
from rosidl_py_gen.compiler.frontend.package_files import PackageBudget as PackageBudget
from rosidl_py_gen.compiler.frontend.package_files import UnreadableError as UnreadableError
from rosidl_py_gen.compiler.frontend.package_files import files_below as files_below
from rosidl_py_gen.compiler.frontend.package_files import note as note
from rosidl_py_gen.compiler.frontend.package_files import read_package_manifest as read_package_manifest
from rosidl_py_gen.compiler.frontend.package_files import read_text as read_text
from rosidl_py_gen.compiler.frontend.package_files import recorded as recorded
from rosidl_py_gen.compiler.frontend.package_files import stamp as stamp
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry as InterfaceRegistry
from rosidl_py_gen.compiler.frontend.search_path import Package as Package
from rosidl_py_gen.compiler.frontend.search_path import SearchPath as SearchPath
from rosidl_py_gen.compiler.frontend.search_path import Workspace as Workspace
from rosidl_py_gen.compiler.frontend.search_path import package_around as package_around
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path as scan_search_path
from rosidl_py_gen.compiler.frontend.type_description_reader import (
    registry_from_descriptions as registry_from_descriptions,
)
from rosidl_py_gen.compiler.frontend.type_description_reader import written_messages as written_messages
