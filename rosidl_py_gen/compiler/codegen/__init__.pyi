# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.compiler.codegen.layout_plan import LayoutPlanner as LayoutPlanner
from rosidl_py_gen.compiler.codegen.module_sources import Target as Target
from rosidl_py_gen.compiler.codegen.module_sources import module_path as module_path
from rosidl_py_gen.compiler.codegen.module_sources import module_source as module_source
from rosidl_py_gen.compiler.codegen.module_sources import preload as preload
