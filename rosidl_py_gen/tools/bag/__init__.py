"""What ``rosidl-py bag`` does: recordings, with `rosidl_py_gen.bags`."""
