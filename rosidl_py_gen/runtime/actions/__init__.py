"""Actions: goals, their states, the server and the client.

May import: endpoints and the rooms below.
"""
