"""Tables: recorded messages as Arrow, Parquet and SQL, and tables as messages.

Needs the extra ``tables``; without it the import raises `ExtraMissingError`, an `ImportError` that has the command.
"""
