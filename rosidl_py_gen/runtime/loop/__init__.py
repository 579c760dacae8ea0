"""Between transport and asyncio: event loops, the binding of a context to one, and callbacks of the user."""
