from rosidl_py_gen.tables.dataset_writer import DatasetFile as DatasetFile
from rosidl_py_gen.tables.dataset_writer import DatasetReport as DatasetReport
from rosidl_py_gen.tables.dataset_writer import write_dataset as write_dataset
from rosidl_py_gen.tables.multi_bag import DatasetsReport as DatasetsReport
from rosidl_py_gen.tables.multi_bag import write_datasets as write_datasets

# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.tables.multi_bag import find_bags as find_bags
from rosidl_py_gen.tables.multi_bag import names_of as names_of
from rosidl_py_gen.tables.query import Database as Database
from rosidl_py_gen.tables.query import Result as Result
from rosidl_py_gen.tables.query import is_dataset as is_dataset
from rosidl_py_gen.tables.query import topics_in as topics_in
from rosidl_py_gen.tables.reading import reader as reader
from rosidl_py_gen.tables.writing import located as located
from rosidl_py_gen.tables.writing import messages_of as messages_of
from rosidl_py_gen.tables.writing import stream_of as stream_of
from rosidl_py_gen.tables.writing import topic_of_schema as topic_of_schema
