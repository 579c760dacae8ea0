# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.plotting.lines import TopicLines as TopicLines
from rosidl_py_gen.plotting.output import Plot as Plot
