"""Groups of commands that import a command's module when the command is used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Mapping

    from click.shell_completion import CompletionItem


class LazyGroup(click.Group):
    """Group of commands, each of which is declared and implemented in one module.

    Args:
        package: package of the modules.
        verbs: names of the commands, each with its module relative to `package` (``.x.y`` is a sibling of the package)
            and the first sentence of its help. A module may declare several commands.
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
        for value in vars(module).values():
            if isinstance(value, click.Command) and value.name == cmd_name:
                return value
        raise AssertionError(f"{module.__name__} has no command {cmd_name}")

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in self.verbs.items()])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        commands = [CompletionItem(name, help=text) for name, (_, text) in self.verbs.items()]
        fitting = [item for item in commands if item.value.startswith(incomplete)]
        return [*fitting, *click.Command.shell_complete(self, ctx, incomplete)]

    def resolve_command(self, ctx: click.Context, args: list[str]) -> tuple[Any, Any, list[str]]:
        if args and args[0] not in self.verbs:
            from rosidl_py_gen.base.names import did_you_mean

            ctx.fail(f'no command "{args[0]}"{did_you_mean(args[0], self.verbs)}')
        return super().resolve_command(ctx, args)
