"""What everything else stands on: names, field types, resources of the package, who may call what.

Imports nothing of this package but `errors`. Names here are not public; what users need of them, `rosidl_py_gen` shows.
"""
