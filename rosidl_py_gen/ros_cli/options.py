"""Options and arguments that several commands share, with their completion from the live graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

F = TypeVar("F", bound=Callable[..., Any])


def _complete_directories(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from rosidl_py_gen.generator_cli.shells import complete_directories

    return complete_directories(ctx, param, incomplete)


def _with_project_path(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    from rosidl_py_gen.base.project import with_project_path

    return with_project_path(value)


show_types = click.option("-t", "--show-types", is_flag=True, help="Show the types.")
as_json = click.option("--json", "as_json", is_flag=True, help="Print JSON for programs.")
paths = click.option(
    "--path",
    "paths",
    multiple=True,
    metavar="DIR",
    shell_complete=_complete_directories,
    callback=_with_project_path,
    help="Where to look for definitions, before the folders of pyproject.toml, AMENT_PREFIX_PATH and the bundled ones; "
    "may be given several times.",
)


def timeout(what: str, default_s: float = 5) -> Callable[[F], F]:
    """``--timeout``, handed on as `timeout_s`; infinity is welcome. `what` says in the help what is waited for."""
    return click.option(
        "--timeout",
        "timeout_s",
        type=click.FloatRange(0),
        default=default_s,
        show_default=True,
        metavar="SECONDS",
        help=what,
    )


report_count = click.option(
    "-n", "--times", type=click.IntRange(1), metavar="COUNT", help="Stop after so many reports."
)
node_timeout = timeout("Wait so long for the node, and for its answers.")
topic_timeout = click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0),
    metavar="SECONDS",
    help="How long to wait for a topic that is not there yet.  [default: 5]",
)


def count(kind: str) -> Callable[[F], F]:
    """``--count-topics`` and the like, handed on as `count`."""
    return click.option("-c", f"--count-{kind}", "count", is_flag=True, help="Print only how many there are.")


def output_format_options(picture: str) -> Callable[[F], F]:
    """As what a command shows what it found: text, Mermaid, JSON or a `picture` of this format; and ``--output``."""

    def add(command: F) -> F:
        for option in (
            click.option(
                "-o",
                "--output",
                metavar="FILE",
                type=click.Path(dir_okay=False),
                help=f"Write a file; its ending says what: .{picture}, .mmd, .md (Mermaid for Markdown), .json, .txt.",
            ),
            click.option("--json", "as_json", is_flag=True, help="Print JSON for programs; the same as --format json."),
            click.option(
                "--format", "kind", type=click.Choice(["text", "mermaid", picture, "json"]), help="Default: text."
            ),
        ):
            command = option(command)
        return command

    return add


def node_options(command: F) -> F:
    """Options of every command that looks at the network; a command hands them on to `session.Session` as `network`."""
    for option in reversed(_NODE_OPTIONS):
        command = option(command)
    return command


def _into_network(ctx: click.Context, param: click.Parameter, value: Any) -> None:
    ctx.params.setdefault("network", {})[param.name] = value


def _network_option(*names: str, **settings: Any) -> Callable[[F], F]:
    return click.option(*names, expose_value=False, callback=_into_network, **settings)


_NODE_OPTIONS = (
    _network_option(
        "--domain",
        "domain_id",
        type=click.IntRange(0, 232),
        metavar="ID",
        help="DDS domain from 0 to 232 instead of ROS_DOMAIN_ID.",
    ),
    _network_option(
        "--discovery",
        type=click.Choice(["localhost", "subnet", "off"]),
        help="How far to look, instead of ROS_AUTOMATIC_DISCOVERY_RANGE.",
    ),
    _network_option(
        "--spin-time",
        "spin_time_s",
        type=click.FloatRange(0, 3600),
        metavar="SECONDS",
        help="Listen this long for others, instead of until nothing new comes.",
    ),
    click.option(
        "--no-daemon",
        is_flag=True,
        expose_value=False,
        callback=lambda ctx, param, value: None,
        help="Accepted for compatibility with ros2, without effect: there is no daemon.",
    ),
)


# ------------------------------------------------------------------------------------------------------------ bags


def split_options(command: F) -> F:
    """When a bag goes on in a new file."""
    for option in reversed(_SPLITS):
        command = option(command)
    return command


def _none_for_zero(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    return value or None


_SPLITS = (
    click.option(
        "-b",
        "--max-bag-size",
        "split_bytes",
        type=click.IntRange(0),
        callback=_none_for_zero,
        metavar="BYTES",
        help="Begin a new file after so many; 0 for never.",
    ),
    click.option(
        "-d",
        "--max-bag-duration",
        "split_s",
        type=click.FloatRange(0),
        callback=_none_for_zero,
        metavar="SECONDS",
        help="Begin a new file after so long; 0 for never.",
    ),
)


# ------------------------------------------------------------------------------------------------- kinds of options


class MultiValueOption(click.Option):
    """An option that takes one word or more, as options of ros2 do: ``--topics /a /b``, or ``--topics /a --topics /b``.

    For a command whose ``cls`` is `MultiValueCommand`.
    """

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        settings["multiple"] = True
        super().__init__(*arguments, **settings)


def topics(command: F) -> F:
    """Add ``--topics`` of a command that reads a bag; its ``cls`` is `MultiValueCommand`."""
    option = click.option(
        "--topics",
        cls=MultiValueOption,
        shell_complete=bag_completion("topic"),
        metavar="TOPIC...",
        help="Only these topics. May be repeated.",
    )
    return option(command)


bag_path = click.argument("path", type=click.Path())
compression = click.option(
    "--compression",
    type=click.Choice(["zstd", "lz4", "none"]),
    default="zstd",
    show_default=True,
    help="Of chunks inside the file.",
)
skip_damaged = click.option(
    "--skip-damaged",
    "skips",
    is_flag=True,
    help="Skip messages that cannot be decoded, and damaged parts of MCAP files; the exit code is 3 then.",
)


def bag_selection(command: F) -> F:
    """Add options that select topics and a time range of a bag; the ``cls`` of the command is `MultiValueCommand`."""
    for option in (
        click.option("--duration", "duration_s", type=click.FloatRange(0), metavar="SECONDS", help="Only so long."),
        click.option(
            "--start-offset",
            "offset_s",
            type=click.FloatRange(0),
            default=0.0,
            metavar="SECONDS",
            help="Leave out the beginning.",
        ),
        topics,
    ):
        command = option(command)
    return command


class MultiValueCommand(click.Command):
    """Gives all words behind an option of `MultiValueOption` to it, up to the next option; completes by the other
    arguments.

    Until the command has the arguments it needs, such an option takes only one: in ``--topics /a my_bag``, the bag
    is none of the topics. Words behind ``--`` count as arguments: ``--topics /a /b -- my_bag``.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        return super().parse_args(ctx, self._spread(ctx, args))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Further words of an option are completed as its first."""
        option = ctx.meta.get(_OPEN)
        if option is None or _is_option(incomplete):
            return super().shell_complete(ctx, incomplete)
        found: list[CompletionItem] = option.shell_complete(ctx, incomplete)
        return found

    def _spread(self, ctx: click.Context, args: list[str]) -> list[str]:
        options = {
            name: param
            for param in self.params
            if isinstance(param, click.Option)
            for name in (*param.opts, *param.secondary_opts)
        }
        arguments = [param for param in self.params if isinstance(param, click.Argument)]
        missing = sum(param.nargs == 1 or param.required for param in arguments)
        missing -= len(args[args.index("--") + 1 :]) if "--" in args else 0
        spread: list[str] = []
        rest = list(args)
        while rest and rest[0] != "--":
            word = rest.pop(0)
            option = options.get(word)
            missing -= option is None and not _is_option(word)
            if option is not None and option.name == _INSTEAD:
                missing = 0
            if option is not None and not option.is_flag and not rest and ctx.resilient_parsing:
                break  # the value is being typed; click would read no arguments then
            if isinstance(option, MultiValueOption):
                spread += word, *rest[:1]
                del rest[:1]
                while missing <= 0 and rest and not _is_option(rest[0]):
                    spread += word, rest.pop(0)
                if not rest and missing <= 0:
                    ctx.meta[_OPEN] = option
                continue
            spread.append(word)
            if option is not None and not option.is_flag and rest and not _is_option(rest[0]):
                spread.append(rest.pop(0))
        return spread + rest


class SeveralArgument(click.Argument):
    """An argument of any number of words, of a `MultiValueCommand`; words behind a `MultiValueOption` option are
    none of them.
    """

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        option = ctx.meta.get(_OPEN)
        if option is None:
            return super().shell_complete(ctx, incomplete)
        found: list[CompletionItem] = option.shell_complete(ctx, incomplete)
        return found


_OPEN = f"{__name__}.open"
"""In a context: the option that the next word belongs to, if it is none itself."""
_INSTEAD = "inputs"
"""Stands for arguments, where a command has it."""


def _is_option(word: str) -> bool:
    return word.startswith("-") and len(word) > 1


# -------------------------------------------------------------------------------------------------------- completion


def completion(what: str) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Complete names.

    Args:
        what: ``topics``, ``services``, ``actions``, ``nodes`` or ``parameters`` of the live graph; ``types``,
            ``service types``, ``action types``, ``interfaces`` (all three) or ``packages`` of the search path.
    """

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from rosidl_py_gen.ros_cli.completion import complete_names

        return complete_names(what, ctx, incomplete)

    return complete


def call_completion(kind: str) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Complete ``[TYPE] [VALUES]`` of a `kind`: topic, service or action."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from rosidl_py_gen.ros_cli.completion import complete_call

        return complete_call(kind, ctx, incomplete)

    return complete


def field_completion(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the path of a field of the topic's messages."""
    from rosidl_py_gen.ros_cli.completion import complete_fields

    return complete_fields(ctx, incomplete)


def bag_completion(kind: str) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Completes names of the bag that is on the command line: `kind` is topic, service or action."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from rosidl_py_gen.ros_cli.completion import complete_bag_names

        return complete_bag_names(kind, ctx, incomplete)

    return complete


def topic_argument(name: str = "topic", **settings: Any) -> Callable[[F], F]:
    """A topic name."""
    return click.argument(name, shell_complete=completion("topics"), **settings)


def service_argument(name: str = "service", **settings: Any) -> Callable[[F], F]:
    """A service name."""
    return click.argument(name, shell_complete=completion("services"), **settings)


def action_argument(name: str = "action", **settings: Any) -> Callable[[F], F]:
    """An action name."""
    return click.argument(name, shell_complete=completion("actions"), **settings)


def node_argument(name: str = "node", **settings: Any) -> Callable[[F], F]:
    """A node name."""
    return click.argument(name, shell_complete=completion("nodes"), **settings)


def parameter_argument(name: str = "name", **settings: Any) -> Callable[[F], F]:
    """A parameter name."""
    return click.argument(name, shell_complete=completion("parameters"), **settings)


def interface_argument(name: str, **settings: Any) -> Callable[[F], F]:
    """A name of a message, service or action, or several."""
    return click.argument(name, shell_complete=completion("interfaces"), **settings)
