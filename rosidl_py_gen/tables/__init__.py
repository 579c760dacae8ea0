"""Tables: recorded messages as Arrow, Parquet and SQL tables, and tables as messages.

Needs the extra ``tables``; without it the import raises `ExtraMissingError`, an `ImportError` that names the command.
"""

from rosidl_py_gen.tables import arrow as _arrow  # noqa: F401  first, as the extra of pyarrow brings all the others
from rosidl_py_gen.tables.dataset_writer import DatasetFile as DatasetFile
from rosidl_py_gen.tables.dataset_writer import DatasetReport as DatasetReport
from rosidl_py_gen.tables.dataset_writer import write_dataset as write_dataset
from rosidl_py_gen.tables.multi_bag import DatasetsReport as DatasetsReport
from rosidl_py_gen.tables.multi_bag import write_datasets as write_datasets
