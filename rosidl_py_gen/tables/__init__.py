"""Tables: recorded messages as Arrow, Parquet and SQL, and tables as messages.

Needs the extra ``tables``; without it the import raises `ExtraMissingError`, an `ImportError` that has the command.
"""

from rosidl_py_gen.tables.dataset import DatasetFile as DatasetFile
from rosidl_py_gen.tables.dataset import DatasetReport as DatasetReport
from rosidl_py_gen.tables.dataset import write_dataset as write_dataset
