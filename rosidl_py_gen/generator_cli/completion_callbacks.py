"""Completion callbacks that import what they need when a shell completes, and that raise nothing.

A shell would print a traceback into the line that is being typed, so an error of any kind results in no suggestions.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    import click
    from click.shell_completion import CompletionItem


def lazy_completion(
    module: str, function: str, *arguments: str
) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Return the callback of a parameter.

    Args:
        function: name in `module`; called with `arguments`, the context, and the incomplete word.
    """

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return suggestions(lambda: getattr(import_module(module), function)(*arguments, ctx, incomplete))

    return complete


def suggestions(find: Callable[[], list[Any]]) -> list[Any]:
    """Return the result of a function, or an empty list if it raises an error or is interrupted."""
    try:
        return find()
    except (Exception, KeyboardInterrupt, SystemExit):
        return []
