"""Layer between transports and asyncio: event loops, the binding of a context to a loop, and callbacks of the user."""
