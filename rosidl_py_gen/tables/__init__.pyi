from rosidl_py_gen.tables.dataset_writer import DatasetFile as DatasetFile
from rosidl_py_gen.tables.dataset_writer import DatasetReport as DatasetReport
from rosidl_py_gen.tables.dataset_writer import write_dataset as write_dataset
from rosidl_py_gen.tables.multi_bag import DatasetsReport as DatasetsReport
from rosidl_py_gen.tables.multi_bag import write_datasets as write_datasets

# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.tables.query import Database as Database
from rosidl_py_gen.tables.reading import reader as reader
from rosidl_py_gen.tables.writing import MessageTable as MessageTable
