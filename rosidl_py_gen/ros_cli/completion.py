"""Shell completion of names, types and fields from the live graph, bags and the search path; command ``completion``.

A completion function that raises an error yields no suggestions.
"""

from __future__ import annotations

import re
import warnings
from contextlib import suppress
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.generator_cli import completion_script, found_items
from rosidl_py_gen.ros_cli import root, verb

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterable, Sequence

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.command_support import CommandNode


T = TypeVar("T")

_TIMEOUT_S = 1.5
"""Maximum time for a request to a node during completion, in seconds, unless ``--spin-time`` is longer."""
_KINDS = {
    "types": ("msg",),
    "service types": ("srv",),
    "action types": ("action",),
    "interfaces": RosName.KINDS,
    "packages": (),
}
_TYPE_KINDS = {"topic": "types", "service": "service types", "action": "action types"}
_INDEX = re.compile(r"\[[^\]]*\]\Z")


def complete_names(what: str, context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete names of the kind `what`, such as ``topics`` or ``types``; hidden names only if ``/_`` was typed."""
    shows_hidden = "/_" in incomplete
    return _items(lambda: [one for one in _names(what, context) if shows_hidden or "/_" not in one], incomplete)


def complete_bag_names(kind: str, context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete names in the bags that the command line names; `kind` is topics, services or actions."""
    return _items(lambda: _bag_names(kind, context), incomplete)


def complete_call(kind: str, context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete the words ``[TYPE] [VALUES]`` after the name of a topic, service or action.

    TYPE is the announced type, or else any type on the search path. VALUES are all fields with their default values.
    """
    words = context.params.get("words") or ()
    if not words:
        announced = _items(lambda: _announced_types(kind, context), incomplete)
        return announced or complete_names(_TYPE_KINDS[kind], context, incomplete)
    if len(words) == 1 and "/" in words[0] and not context.params.get("stdin"):
        return _items(lambda: [_prototype(kind, words[0], context)], incomplete)
    return []


def complete_fields(context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete the path of a field in the messages of the topic that the command line names."""
    return _items(lambda: _field_paths(_class("topic", None, context), incomplete), incomplete)


def complete_plot_words(source: str, context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete a word of ``/TOPIC FIELD...``, from the live ``graph``, or from the ``bag`` whose path precedes it."""
    words = context.params.get("words") or ()
    if source == "bag":
        if not words:
            return [CompletionItem(incomplete, type="file")]
        return _items(lambda: _plotted_in_bag(words, context, incomplete), incomplete)
    topics = [word for word in words if word.startswith("/")]
    if incomplete.startswith("/") or not topics:
        return complete_names("topics", context, incomplete)
    context.params["topic"] = topics[-1]
    return complete_fields(context, incomplete)


def complete_launch_words(context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete the words ``PACKAGE FILE``, or the path of a launch file, of ``rosidl-py launch``."""
    words = context.params.get("words") or ()
    if words:
        return complete_names("launch files", context, incomplete) if len(words) == 1 else []
    return [*complete_names("workspace packages", context, incomplete), CompletionItem("", type="file")]


def _plotted_in_bag(words: Sequence[str], context: click.Context, incomplete: str) -> list[str]:
    from rosidl_py_gen.bags import BagReader

    topics = [word for word in words[1:] if word.startswith("/")]
    if incomplete.startswith("/") or not topics:
        context.params["path"] = words[0]
        return _bag_names("topic", context)
    with BagReader(words[0]) as reader:
        return _field_paths(reader.message_class(topics[-1]), incomplete)


def complete_enclaves(context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Complete names of enclaves in the keystore that the command line names."""
    from rosidl_py_gen.security import Keystore

    return _items(lambda: Keystore(Path(context.params["root"]), lambda text: None).list_enclaves(), incomplete)


def _items(find: Callable[[], Iterable[str]], incomplete: str) -> list[CompletionItem]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return found_items(find, incomplete)


def _names(what: str, context: click.Context) -> list[str]:
    paths = context.params.get("paths") or ()
    if what in _KINDS:
        from rosidl_py_gen.ros_cli.definitions import known_names

        return known_names(_KINDS[what], paths)
    if what in ("workspace packages", "launch files"):
        from rosidl_py_gen.prefix import workspaces

        folders = {name: folder for one in reversed(workspaces(paths)) for name, folder in one.packages.items()}
        if what == "workspace packages":
            return [*folders]
        from rosidl_py_gen.compiler.frontend import PackageFiles

        names = (PurePath(one).name for one in PackageFiles(folders[context.params["words"][0]]).paths())
        return sorted({name for name in names if "launch" in name})
    return _query(context, lambda command_node: _live_names(what, command_node, context))


def _query(context: click.Context, request: Callable[[CommandNode], Awaitable[T]]) -> T:
    """Create a command node, wait for discovery, call `request` with the node, and return its result."""
    import asyncio

    from rosidl_py_gen.command_support import CommandNode

    async def main() -> T:
        async with CommandNode(context.params.get("network", {})) as command_node:
            await command_node.wait_for_discovery()
            return await request(command_node)

    return asyncio.run(main())


def _timeout_s(context: click.Context) -> float:
    return max(context.params.get("network", {}).get("spin_time_s") or 0.0, _TIMEOUT_S)


async def _live_names(what: str, command_node: CommandNode, context: click.Context) -> list[str]:
    if what == "parameters":
        client = command_node.node.create_parameter_client(command_node.full_name(context.params["node"], "node"))
        return list((await client.list(timeout_s=_timeout_s(context))).names)
    names = command_node.names(what.removesuffix("s"))
    return [name for name in names if what != "topics" or "/_action/" not in name]


def _bag_names(kind: str, context: click.Context) -> list[str]:
    from rosidl_py_gen.bags import BagReader
    from rosidl_py_gen.ros_cli.bag.topic_owner import topic_owner

    words = context.params
    names: set[str] = set()
    for path in filter(None, (words.get("path"), *(words.get("inputs") or ()), *(words.get("bags") or ()))):
        with BagReader(path) as reader:
            owners = (topic_owner(one.name, one.type_name) for one in reader.topics.values())
            names |= {one.name for one in owners if one.kind == kind}
    return sorted(names)


def _announced_types(kind: str, context: click.Context) -> list[str]:
    async def request(command_node: CommandNode) -> list[str]:
        name = command_node.full_name(context.params[kind], kind)
        return command_node.announced_types(kind, name)

    return _query(context, request)


def _prototype(kind: str, type_name: str, context: click.Context) -> str:
    from rosidl_py_gen import to_dict
    from rosidl_py_gen.ros_cli.message_text import to_yaml

    cls = _class(kind, type_name, context)
    filled_in = cls if kind == "topic" else cls.Request if kind == "service" else cls.Goal
    return to_yaml(to_dict(filled_in()), flow=True).rstrip("\n")


def _class(kind: str, type_name: str | None, context: click.Context) -> Any:
    """Return the class of a topic's messages, of a service or of an action, which is installed or has the announced
    type.
    """
    import asyncio

    from rosidl_py_gen import get_action, get_message, get_service
    from rosidl_py_gen.command_support import interface_class

    type_name = type_name or context.params.get("type_name")
    paths = context.params.get("paths") or ()
    if type_name:
        with suppress(RosidlError):
            installed = {"topic": get_message, "service": get_service, "action": get_action}
            return installed[kind](type_name, path=paths)

    async def request(command_node: CommandNode) -> Any:
        name = command_node.full_name(context.params[kind], kind)
        resolving = interface_class(command_node, kind, name, type_name, paths)
        return await asyncio.wait_for(resolving, _timeout_s(context))

    return _query(context, request)


def _field_paths(cls: type[Message], incomplete: str) -> list[str]:
    """Return completions of a field path: matching fields; if only one field matches, the fields inside it as well."""
    *parents, last = incomplete.split(".")
    for name in parents:
        fields = {field.ros_name: field for field in cls._TYPE.fields}
        inner = fields[_INDEX.sub("", name)].cls
        if inner is None:
            return []
        cls = inner
    before = "".join(f"{name}." for name in parents)
    fitting = [field for field in cls._TYPE.fields if field.ros_name.startswith(last)]
    paths = [before + field.ros_name for field in fitting]
    if len(fitting) == 1 and fitting[0].cls is not None:
        index = "" if fitting[0].type.arity is Arity.SCALAR else "[0]"
        paths += [f"{paths[0]}{index}.{field.ros_name}" for field in fitting[0].cls._TYPE.fields]
    return paths


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@verb
def completion(shell: str) -> None:
    """Print the completion script of a shell. Names of topics, services and nodes come from the live graph.

    \b
    eval "$(rosidl-py completion bash)"          # in ~/.bashrc; zsh: the same in ~/.zshrc
    rosidl-py completion fish > ~/.config/fish/completions/rosidl-py.fish
    """
    click.echo(completion_script(shell, root(), "rosidl-py"))
