"""Tables: recorded messages as Arrow, Parquet and SQL tables, and tables as messages.

Needs the extra ``tables``; without it the import raises `ExtraMissingError`, an `ImportError` that names the command.
"""

from rosidl_py_gen.cdr.lazy import stub_exports
from rosidl_py_gen.tables import arrow as _arrow  # noqa: F401  first, as the extra of pyarrow brings all the others

__getattr__, __dir__, __all__ = stub_exports(__name__)
