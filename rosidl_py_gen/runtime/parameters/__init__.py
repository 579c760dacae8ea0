"""Parameters of a node: values, validation, files, services, and clients of other nodes."""
