"""Message types of other nodes: what they announce, and the service ``~/get_type_description``."""
