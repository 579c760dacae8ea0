"""Message types of other nodes: search by the announcements of nodes, and the service ``~/get_type_description``."""
