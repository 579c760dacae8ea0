"""Layer between transports and asyncio: event loops, the connection of a context to a loop, and callbacks
of the user.
"""
