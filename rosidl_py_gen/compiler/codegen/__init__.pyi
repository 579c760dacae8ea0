# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.compiler.codegen.module_sources import ModuleSources as ModuleSources
