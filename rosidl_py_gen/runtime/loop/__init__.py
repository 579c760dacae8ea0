"""Between transport and asyncio: who waits for data, where callbacks run, and what waiting code is told.

May import: logs, transport, time.
"""
