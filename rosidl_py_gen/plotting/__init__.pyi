# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.plotting.lines import PlotPanel as PlotPanel
from rosidl_py_gen.plotting.lines import TimeAxis as TimeAxis
from rosidl_py_gen.plotting.lines import TopicLines as TopicLines
from rosidl_py_gen.plotting.lines import topics_and_fields as topics_and_fields
from rosidl_py_gen.plotting.output import count_text as count_text
from rosidl_py_gen.plotting.output import live_plot as live_plot
from rosidl_py_gen.plotting.output import plot_window as plot_window
from rosidl_py_gen.plotting.output import print_plot as print_plot
from rosidl_py_gen.plotting.output import require_output as require_output
from rosidl_py_gen.plotting.output import show_plot as show_plot
