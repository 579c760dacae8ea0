"""Groups of commands that know the names and the short help of their commands, and import a command when it is used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Mapping

    from click.shell_completion import CompletionItem


class LazyGroup(click.Group):
    """Group of commands, each of which is declared and implemented in a module of its own.

    Args:
        package: where the modules are.
        verbs: by name the module below `package` (``.x.y`` is one beside it), and the begin of the command's help. A
            module may have several commands that do nearly the same.
    """

    def __init__(self, *arguments: Any, package: str, verbs: Mapping[str, tuple[str, str]], **settings: Any) -> None:
        settings["no_args_is_help"] = True
        super().__init__(*arguments, **settings)
        self._package = package
        self.verbs = dict(sorted(verbs.items()))

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.verbs)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.verbs:
            return None
        module = import_module(f".{self.verbs[cmd_name][0]}", self._package)
        for found in vars(module).values():
            if isinstance(found, click.Command) and found.name == cmd_name:
                return found
        raise AssertionError(f"{module.__name__} has no command {cmd_name}")

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in self.verbs.items()])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        found = [
            CompletionItem(name, help=text) for name, (_, text) in self.verbs.items() if name.startswith(incomplete)
        ]
        return [*found, *click.Command.shell_complete(self, ctx, incomplete)]

    def resolve_command(self, ctx: click.Context, args: list[str]) -> tuple[Any, Any, list[str]]:
        if args and args[0] not in self.verbs:
            from rosidl_py_gen.base.names import did_you_mean

            ctx.fail(f'no command "{args[0]}"{did_you_mean(args[0], self.verbs)}')
        return super().resolve_command(ctx, args)
