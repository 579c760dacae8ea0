"""Names of nodes, topics and services: validation, expansion and remapping."""
