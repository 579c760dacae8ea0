"""Parser of .msg, .srv and .action files, in `rosidl_adapter.parser`; the conversion to .idl files is not included."""
