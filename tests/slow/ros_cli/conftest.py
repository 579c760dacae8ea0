"""Commands for tests."""

from support.commands import run_here, tool, topic_peer

__all__ = ["run_here", "tool", "topic_peer"]
