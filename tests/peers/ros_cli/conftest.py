"""Commands for tests."""

from support.commands import run_here, tool

__all__ = ["run_here", "tool"]
