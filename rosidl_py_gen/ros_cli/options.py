"""Options and arguments that several commands share.

Help and completion import this module, so it imports nothing that takes time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Coroutine, Iterable
from functools import partial, wraps
from math import isfinite
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.generator_cli import distro, lazy_completion
from rosidl_py_gen.ros_cli import AsyncCommand, verb

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from rosidl_py_gen.command_support import NetworkOptions as NetworkOptions

F = TypeVar("F", bound=Callable[..., Any])


class FiniteRange(click.FloatRange):
    """Click type of options with a number in a range, without NaN and infinities, which `click.FloatRange` accepts."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number of an option's text; fail if it is out of the range or not finite."""
        number = super().convert(value, param, ctx)
        if not isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number

    def _describe_range(self) -> str:
        """Return the range as click prints it in a help text; empty without limits, for which click prints None."""
        return "" if self.min is None is self.max else super()._describe_range()


def compile_pattern(text: str, option: str) -> re.Pattern[str]:
    """Return the compiled form of a regular expression on a command line; raises `CommandError` if it is invalid."""
    try:
        return re.compile(text)
    except re.error as error:
        raise CommandError(f'{option}: "{text}" is not a regular expression: {error}') from None


def all_of(*options: Callable[[F], F]) -> Callable[[F], F]:
    """Return a decorator that adds several options to a command, in the given order."""

    def add(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def _with_project_path(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    from rosidl_py_gen.base.project import with_project_path

    return with_project_path(value)


show_types = click.option("-t", "--show-types", is_flag=True, help="Show the types.")
as_json = click.option("--json", "as_json", is_flag=True, help="Print JSON for programs.")
_path = click.option(
    "--path",
    "paths",
    multiple=True,
    metavar="DIR",
    shell_complete=lazy_completion("rosidl_py_gen.generator_cli", "complete_directories"),
    callback=_with_project_path,
    help="Folder with interface packages; searched before the folders of pyproject.toml, AMENT_PREFIX_PATH, installed "
    "and bundled packages. May be repeated.",
)


def paths(command: F) -> F:
    """Add the options ``--path`` and ``--distro`` to a command, which select definitions."""
    return _path(distro(command))  # type: ignore[no-any-return]


def seconds(*names: str, maximum: float | None = None, **settings: Any) -> Callable[[F], F]:
    """Return a decorator that adds an option with a time in seconds."""
    kind = click.FloatRange(0, maximum)
    return click.option(*names, type=kind, metavar="SECONDS", show_default="default" in settings, **settings)


def rate(*names: str, **settings: Any) -> Callable[[F], F]:
    """Return a decorator that adds an option with a rate in Hz."""
    kind = click.FloatRange(0, min_open=True)
    return click.option(*names, type=kind, metavar="HZ", show_default="default" in settings, **settings)


def window(default: int) -> Callable[[F], F]:
    """Add the option ``--window`` to a command that computes statistics."""
    text = "Number of the last messages to compute with."
    kind = click.IntRange(2)
    return click.option("-w", "--window", type=kind, default=default, show_default=True, metavar="N", help=text)


def timeout(help_text: str, default_s: float = 5) -> Callable[[F], F]:
    """Add the option ``--timeout`` to a command, passed as `timeout_s`; it may be infinite."""
    return seconds("--timeout", "timeout_s", default=default_s, help=help_text)


report_count = click.option("-n", "--times", type=click.IntRange(1), metavar="N", help="Stop after N reports.")
node_timeout = timeout("Maximum time to wait for the node, and for each of its replies.")
topic_timeout = seconds("--timeout", "timeout_s", help="Maximum time to wait for the topic.  [default: 5]")


def count(kind: str) -> Callable[[F], F]:
    """Return a decorator that adds the option ``--count-KIND``, passed as `count`."""
    return click.option("-c", f"--count-{kind}", "count", is_flag=True, help=f"Print only the number of {kind}.")


_TEXT_FORMATS = {".mmd": "mermaid", ".mermaid": "mermaid", ".md": "markdown", ".json": "json", ".txt": "text"}


def output_format_options(picture: str) -> Callable[[F], F]:
    """Add ``--format`` (text, Mermaid, JSON, or a `picture` of this format), ``--json`` and ``--output``."""
    return all_of(
        click.option(
            "--format",
            "kind",
            type=click.Choice(["text", "mermaid", picture, "json"]),
            help="Output format.  [default: text]",
        ),
        click.option("--json", "as_json", is_flag=True, help="Print JSON for programs, as --format json."),
        click.option(
            "-o",
            "--output",
            metavar="FILE",
            type=click.Path(dir_okay=False),
            help=f"Write a file; its suffix selects the format: .{picture}, .mmd, .md (Mermaid), .json, .txt.",
        ),
    )


def output_format(picture: str, kind: str | None, as_json: bool, output: str | None) -> str:
    """Return the format that `output_format_options` select; raises `CommandError` for another suffix."""
    if as_json or kind is not None or output is None:
        return "json" if as_json else kind or "text"
    formats = {f".{picture}": picture, **_TEXT_FORMATS}
    if (suffix := PurePath(output).suffix.lower()) not in formats:
        raise CommandError(
            f"{output}: the suffix selects the format; expected one of {', '.join(formats)}, or --format"
        )
    return formats[suffix]


def _into_network(ctx: click.Context, param: click.Parameter, value: Any) -> None:
    ctx.params.setdefault("network", {})[param.name] = value


_network_option = partial(click.option, expose_value=False, callback=_into_network)
plot_options = all_of(
    click.option(
        "-o",
        "--output",
        "--out",
        "out",
        type=click.Path(dir_okay=False),
        metavar="FILE",
        help="Write a file; its ending selects the format: .png, .svg, .pdf, ...",
    ),
    click.option("--terminal", "in_terminal", is_flag=True, help="Draw in the terminal, even if windows can open."),
    click.option("--stamp", "by_stamp", is_flag=True, help="Time of header.stamp, instead of the time of receipt."),
    click.option("--wall-clock", is_flag=True, help="Local date and time on the time axis, instead of seconds."),
)
"""Options that ``bag plot`` and ``topic plot`` share."""


def topics_and_fields(words: Iterable[str]) -> list[tuple[str, list[str]]]:
    """Return topics and their fields from the words ``/topic FIELD... /other FIELD...``; raises `CommandError`."""
    topics: dict[str, list[str]] = {}
    at: list[str] | None = None
    for word in words:
        if word.startswith("/"):
            at = topics.setdefault(word, [])
        elif at is None:
            raise CommandError(f"{word}: expected a topic such as /odom, which begins with a slash, before its fields")
        else:
            at.append(word)
    return list(topics.items())


node_options = all_of(
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
        help="Range in which peers are discovered, instead of ROS_AUTOMATIC_DISCOVERY_RANGE.",
    ),
    _network_option(
        "--spin-time",
        "spin_time_s",
        type=click.FloatRange(0, 3600),
        metavar="SECONDS",
        help="Time to wait for peers. By default a command waits until discovery is quiet, at most 2 s.",
    ),
    click.option(
        "--no-daemon",
        is_flag=True,
        expose_value=False,
        callback=lambda ctx, param, value: None,
        help="No effect; accepted for compatibility with ros2, as there is no daemon.",
    ),
)
"""Options of every command that has a node, passed as `network` (`NetworkOptions`)."""


def endless_node_verb(
    is_endless: Callable[[dict[str, Any]], object],
) -> Callable[[Callable[..., Coroutine[Any, Any, int | None]]], Callable[..., None]]:
    """Decorate the callback of a command with `node_options`; it gets a `CommandNode` instead of `network`.

    With the arguments for which `is_endless` is true, the command is an endless one.
    """

    def decorate(function: Callable[..., Coroutine[Any, Any, int | None]]) -> Callable[..., None]:
        @wraps(function)
        def run(network: NetworkOptions, **arguments: Any) -> AsyncCommand:
            async def main() -> int | None:
                from rosidl_py_gen.command_support import CommandNode

                async with CommandNode(network) as command_node:
                    return await function(command_node=command_node, **arguments)

            return AsyncCommand(main(), endless=bool(is_endless(arguments)))

        return node_options(verb(run))

    return decorate


node_verb = endless_node_verb(lambda arguments: False)


# ------------------------------------------------------------------------------------------------------------ bags


def _none_for_zero(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    return value or None


split_options = all_of(
    click.option(
        "-b",
        "--max-bag-size",
        "split_bytes",
        type=click.IntRange(0),
        callback=_none_for_zero,
        metavar="BYTES",
        help="Maximum size of a file; 0 means no limit.",
    ),
    seconds(
        "-d",
        "--max-bag-duration",
        "split_s",
        callback=_none_for_zero,
        help="Maximum duration of a file; 0 means no limit.",
    ),
)
"""Options for limits after which a bag continues in a new file."""
no_keys = click.option("--disable-keyboard-controls", "no_keys", is_flag=True, help="Do not read the keyboard.")
output_storage = click.option(
    "-s",
    "--storage",
    type=click.Choice(["mcap", "sqlite3"]),
    default="mcap",
    show_default=True,
    help="Storage format of the output bag.",
)


# ------------------------------------------------------------------------------------------------- kinds of options


class MultiValueOption(click.Option):
    """Option with one or more values, as in ros2: ``--topics /a /b``, or ``--topics /a --topics /b``.

    The ``cls`` of its command is `MultiValueCommand`.
    """

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        settings["multiple"] = True
        super().__init__(*arguments, **settings)


several = partial(click.option, cls=MultiValueOption)
start_offset = click.option(
    "--start-offset",
    "offset_s",
    type=FiniteRange(0),
    default=0.0,
    show_default=True,
    metavar="SECONDS",
    help="Time to skip at the beginning.",
)
duration = click.option(
    "--duration", "duration_s", type=FiniteRange(0), metavar="SECONDS", help="Duration of the selected part."
)
bag_path = click.argument("path", type=click.Path())
compression = click.option(
    "--compression",
    type=click.Choice(["zstd", "lz4", "none"]),
    default="zstd",
    show_default=True,
    help="Compression of the chunks in the file.",
)
without_definitions = click.option(
    "--without-definitions",
    is_flag=True,
    help="Also copy topics without a known definition; they cannot be decoded without it.",
)
skip_damaged = click.option(
    "--skip-damaged",
    "skips",
    is_flag=True,
    help="Skip messages that cannot be decoded, and damaged parts of MCAP files; the exit code is 3 then.",
)


class MultiValueCommand(click.Command):
    """Command whose `MultiValueOption` options take all words up to the next option.

    Until the command has its required arguments, such an option takes one word only: in ``--topics /a my_bag`` the
    bag is an argument. Words after ``--`` are arguments: ``--topics /a /b -- my_bag``.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        return super().parse_args(ctx, self._spread(ctx, args))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete further values of an option as its first one."""
        option: click.Option | None = ctx.meta.get(_OPEN)
        if option is None or _is_option(incomplete):
            return super().shell_complete(ctx, incomplete)
        return option.shell_complete(ctx, incomplete)

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
    """Click argument of a `MultiValueCommand` that takes any number of words."""

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        option: click.Option | None = ctx.meta.get(_OPEN)
        return super().shell_complete(ctx, incomplete) if option is None else option.shell_complete(ctx, incomplete)


_OPEN = f"{__name__}.open"
"""Key in a click context under which the option that takes the next word is stored."""
_INSTEAD = "inputs"
"""Name of the option that replaces the arguments of its command."""


def _is_option(word: str) -> bool:
    return word.startswith("-") and len(word) > 1


# -------------------------------------------------------------------------------------------------------- completion


_completer = partial(lazy_completion, "rosidl_py_gen.ros_cli.completion")
completion = partial(_completer, "complete_names")
"""Function that returns a completion callback for names of a kind: ``topics``, ``services``, ``actions``, ``nodes`` or
``parameters`` of the live graph; ``types``, ``service types``, ``action types``, ``interfaces`` (all three) or
``packages`` of the search path; or ``workspace packages``."""
call_completion = partial(_completer, "complete_call")
"""Function that returns a completion callback for ``[TYPE] [VALUES]`` of a ``topic``, ``service`` or ``action``."""
bag_completion = partial(_completer, "complete_bag_names")
"""Function that returns a completion callback for topics, services or actions of the bag on the command line."""
plot_completion = partial(_completer, "complete_plot_words")
"""Function that returns a completion callback for topics and fields, of a ``bag`` or of the live ``graph``."""
field_completion = _completer("complete_fields")
launch_completion = _completer("complete_launch_words")
enclave_completion = _completer("complete_enclaves")


def _argument(default_name: str, what: str) -> Callable[..., Callable[[F], F]]:
    def argument(name: str = default_name, **settings: Any) -> Callable[[F], F]:
        return click.argument(name, shell_complete=completion(what), **settings)

    return argument


topic_argument = _argument("topic", "topics")
service_argument = _argument("service", "services")
action_argument = _argument("action", "actions")
node_argument = _argument("node", "nodes")
parameter_argument = _argument("name", "parameters")
interface_argument = _argument("name", "interfaces")
topics = several(
    "--topics",
    shell_complete=bag_completion("topic"),
    metavar="TOPIC...",
    help="Only these topics. May be repeated.",
)
"""Option ``--topics``, which selects topics of a bag; the ``cls`` of the command is `MultiValueCommand`."""
bag_selection = all_of(topics, start_offset, duration)
"""Options that select topics and a time range of a bag; the ``cls`` of the command is `MultiValueCommand`."""
