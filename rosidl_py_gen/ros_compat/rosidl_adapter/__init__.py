"""Package with the parser of .msg, .srv and .action files, `rosidl_adapter.parser`, but no conversion to .idl files."""
