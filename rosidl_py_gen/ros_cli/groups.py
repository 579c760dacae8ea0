"""Table of all commands, and groups that import the module of a command when it is used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Mapping

    from click.shell_completion import CompletionItem

COMMANDS: dict[str, tuple[str, str | dict[str, str]]] = {
    "action": ("Actions: list, find, type, info, send_goal.", {"find info list send_goal type": "action"}),
    "bag": (
        "Recordings: record, play, info, convert, merge, migrate, reindex; as tables: table, sql; as a plot: plot; as "
        "pictures: images, video.\n\n"
        "Bags are MCAP files, and rosbag2 folders of MCAP or SQLite files.",
        {
            **{name: f"bag.{name}" for name in ("info", "merge", "migrate", "plot")},
            "convert reindex": "bag.convert",
            "images": "bag.images",
            "video": "bag.video",
            "play": "playback",
            "record": "recording",
            "sql table": "bag.tables",
        },
    ),
    "completion": ("Print the completion script of a shell.", "completion"),
    "demo": ("Run a small robot that drives in a room.", "demo"),
    "doctor": ("Check this installation, the settings, the network and its peers.", "doctor"),
    "foxglove": ("Show topics, parameters and services live in Foxglove or Lichtblick.", "foxglove"),
    "graph": ("Nodes and topics as text, Mermaid or SVG.", "graph"),
    "interface": (
        "Definitions of messages, services and actions: those bundled, of AMENT_PREFIX_PATH and of --path.",
        {"hash list package packages proto show": "interface"},
    ),
    "launch": ("Run a launch file without building its workspace.", "launch"),
    "lifecycle": (
        "Lifecycle nodes: list them, get and set their states, list their transitions.",
        {"get list nodes set": "lifecycle"},
    ),
    "log": ("Print the log messages of all nodes.", "log"),
    "node": ("Nodes: list, info.", {"info list": "node"}),
    "param": (
        "Parameters: list, get, set, describe, dump, load, delete.",
        {"delete describe dump get list load set": "param"},
    ),
    "prefix": ("Create an ament prefix of a workspace, without a build.", "prefix"),
    "run": ("Run a program written for rclpy without changes.", "run"),
    "security": (
        "Keystores for secured networks (SROS2): keys, certificates, permissions, policies.",
        {
            "create_enclave create_keystore create_permission generate_artifacts generate_policy list_enclaves": (
                "security"
            ),
        },
    ),
    "service": ("Services: list, find, type, info, call, echo.", {"call echo find info list type": "service"}),
    "test": ("Run the pytest tests of a package.", "run"),
    "tf": (
        "Transforms: frames as a tree, one transform, rates and delays.",
        {"echo monitor tree": "tf"},
    ),
    "topic": (
        "Topics: list, info, echo, pub, hz, bw, delay, plot, type, find.",
        {
            "bw delay hz": "topic.measure",
            "find info list type": "topic.info",
            **{name: f"topic.{name}" for name in ("echo", "plot", "pub")},
        },
    ),
    "zenoh-router": ("Run a Zenoh router for nodes on rmw_zenoh.", "zenoh_router"),
}
"""Table of all commands with the help and the module of each; for a group, modules by the names of its commands."""

_EXAMPLES = {
    "action": (
        "action list -t",
        "action send_goal /fibonacci example_interfaces/action/Fibonacci '{order: 5}' --feedback",
    ),
    "bag": (
        "bag record --all --output drive",
        "bag info drive",
        "bag play drive --rate 2",
    ),
    "interface": (
        "interface show sensor_msgs/msg/LaserScan",
        "interface proto std_srvs/srv/SetBool",
    ),
    "lifecycle": (
        "lifecycle get /camera",
        "lifecycle set /camera activate",
    ),
    "node": (
        "node list",
        "node info /talker",
    ),
    "param": (
        "param list /talker",
        "param get /talker use_sim_time",
        "param set /talker use_sim_time true",
    ),
    "security": (
        "security create_keystore keystore",
        "security create_enclave keystore /talker",
    ),
    "service": (
        "service list -t",
        "service call /add_two_ints '{a: 1, b: 2}'",
    ),
    "tf": (
        "tf tree",
        "tf echo map base_link",
    ),
    "topic": (
        "topic list -t",
        "topic echo /chatter",
        "topic pub --once /chatter std_msgs/msg/String '{data: hello}'",
        "topic hz /scan",
    ),
}
"""Examples for the help of each command group, without the name of the program."""
_HINTS = {
    "component": "components are shared libraries of C++, which this package does not load",
    "daemon": "there is no daemon, because each command discovers nodes",
    "multicast": "`rosidl-py doctor` checks multicast",
    "pkg": "`rosidl-py run --list` prints packages with executables, `rosidl-py interface packages` message packages",
    "wtf": "`rosidl-py doctor` checks the installation and the network",
}
"""Hints in errors for commands of ros2 that ``rosidl-py`` does not have."""
_HELP = """Inspect a running ROS 2 system and interact with it. No ROS installation is needed.

\b
rosidl-py topic list -t
rosidl-py topic echo /chatter
rosidl-py service call /add_two_ints '{a: 1, b: 2}'

ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE are used; --domain and --discovery of each command replace them.
"""


def root_group() -> click.Group:
    """Return the click group ``rosidl-py`` with all its commands."""
    settings = {"help_option_names": ["-h", "--help"], "max_content_width": 120}
    return LazyGroup(None, COMMANDS, context_settings=settings, help=_HELP)


class LazyGroup(click.Group):
    """Group of commands, whose modules are imported when they are used; a module may declare several commands.

    Args:
        table: help and module of each command, as in `COMMANDS`; if the help is empty, the help of the command is used.
    """

    def __init__(
        self, name: str | None, table: Mapping[str, tuple[str, str | dict[str, str]]], **settings: Any
    ) -> None:
        super().__init__(name, no_args_is_help=True, **settings)
        self._table = dict(sorted(table.items()))

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self._table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self._table:
            return None
        text, where = self._table[cmd_name]
        if isinstance(where, dict):
            modules = {verb: ("", module) for verbs, module in where.items() for verb in verbs.split()}
            examples = "\n".join(f"rosidl-py {words}" for words in _EXAMPLES[cmd_name])
            return LazyGroup(cmd_name, modules, help=f"{text}\n\n\b\n{examples}")
        declared = vars(import_module(f"rosidl_py_gen.ros_cli.{where}")).values()
        return next(one for one in declared if isinstance(one, click.Command) and one.name == cmd_name)

    def _short_help(self, ctx: click.Context) -> dict[str, str]:
        texts = {}
        for name, (text, _) in self._table.items():
            command = None if text else self.get_command(ctx, name)
            texts[name] = command.get_short_help_str(1000) if command else text.partition("\n")[0]
        return texts

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([*self._short_help(ctx).items()])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        commands = [CompletionItem(name, help=text) for name, text in self._short_help(ctx).items()]
        fitting = [item for item in commands if item.value.startswith(incomplete)]
        return [*fitting, *click.Command.shell_complete(self, ctx, incomplete)]

    def resolve_command(self, ctx: click.Context, args: list[str]) -> tuple[Any, Any, list[str]]:
        if args and args[0] not in self._table:
            from rosidl_py_gen.base.names import did_you_mean
            from rosidl_py_gen.generator_cli import HintedUsageError

            if ctx.parent is None and args[0] in _HINTS:
                raise HintedUsageError(f'no command "{args[0]}"', _HINTS[args[0]], ctx)
            hint = f"expected one of {', '.join(self._table)}; --help explains them"
            raise HintedUsageError(f'no command "{args[0]}"{did_you_mean(args[0], self._table)}', hint, ctx)
        return super().resolve_command(ctx, args)
