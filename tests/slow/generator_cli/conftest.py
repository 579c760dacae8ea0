"""A shell for commands."""

from support.generator_shell import shell

__all__ = ["shell"]
