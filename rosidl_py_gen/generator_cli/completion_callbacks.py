"""Completion callbacks of click parameters; they never raise, and import modules only when a shell completes.

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
    """Return a completion callback for a click parameter that calls a function of a module imported only then.

    Args:
        module: name of the module.
        function: name of the function; called with `arguments`, the click context and the incomplete word.
    """

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return suggestions(lambda: getattr(import_module(module), function)(*arguments, ctx, incomplete))

    return complete


def suggestions(find: Callable[[], list[Any]]) -> list[Any]:
    """Call `find` and return its result; return an empty list if `find` raises an error or is interrupted."""
    try:
        return find()
    except (Exception, KeyboardInterrupt, SystemExit):
        return []
