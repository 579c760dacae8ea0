# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.compiler.frontend.bag_text_reader import registry_from_text as registry_from_text
from rosidl_py_gen.compiler.frontend.bundled import BundledInterfaces as BundledInterfaces
from rosidl_py_gen.compiler.frontend.cmake_reader import CMakeScript as CMakeScript
from rosidl_py_gen.compiler.frontend.definition_text import DefinitionText as DefinitionText
from rosidl_py_gen.compiler.frontend.literal_values import LiteralProblem as LiteralProblem
from rosidl_py_gen.compiler.frontend.literal_values import file_scalar as file_scalar
from rosidl_py_gen.compiler.frontend.literal_values import split_strings as split_strings
from rosidl_py_gen.compiler.frontend.model import ConstantDef as ConstantDef
from rosidl_py_gen.compiler.frontend.model import FieldDef as FieldDef
from rosidl_py_gen.compiler.frontend.model import MessageDef as MessageDef
from rosidl_py_gen.compiler.frontend.model import is_interface_name as is_interface_name
from rosidl_py_gen.compiler.frontend.package_files import PackageBudget as PackageBudget
from rosidl_py_gen.compiler.frontend.package_files import PackageFiles as PackageFiles
from rosidl_py_gen.compiler.frontend.package_files import ReadPaths as ReadPaths
from rosidl_py_gen.compiler.frontend.package_files import UnreadableError as UnreadableError
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry as InterfaceRegistry
from rosidl_py_gen.compiler.frontend.search_path import Package as Package
from rosidl_py_gen.compiler.frontend.search_path import SearchPath as SearchPath
from rosidl_py_gen.compiler.frontend.search_path import Workspace as Workspace
from rosidl_py_gen.compiler.frontend.type_description_reader import DescribedInterface as DescribedInterface
