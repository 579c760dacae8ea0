"""Search for the message types of other nodes by the announcements of nodes, and the service
``~/get_type_description``.
"""
