"""``rosidl-py`` as a whole: help, completion in shells, and exit codes."""

from __future__ import annotations

import asyncio
import inspect
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import pytest
from click.shell_completion import BashComplete, get_completion_class
from std_msgs.msg import String
from std_srvs.srv import Trigger
from support.interface_packages import write
from support.program_processes import PACKAGE_XML
from support.waiting import until

from rosidl_py_gen import get_action, get_message, ros_cli
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.command_support import report
from rosidl_py_gen.generator_cli import cli as generator
from rosidl_py_gen.generator_cli import shells

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.worlds import World


def test_unknown_command_exits_with_2_and_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        ros_cli.main(["topik"])
    assert end.value.code == 2
    assert 'did you mean "topic"?' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("component", "components are shared libraries of C++"),
        ("daemon", "there is no daemon"),
        ("multicast", "`rosidl-py doctor` checks multicast"),
        ("pkg", "`rosidl-py run --list` prints packages"),
        ("wtf", "`rosidl-py doctor` checks the installation"),
    ],
)
def test_command_of_ros2_that_does_not_exist_has_a_hint(
    name: str, hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        ros_cli.main([name])
    error, advice = capsys.readouterr().err.splitlines()
    assert (
        end.value.code == 2 and error == f'error: rosidl-py: no command "{name}"' and advice.startswith(f"hint: {hint}")
    )


def test_completion_of_a_field_before_the_topic_has_no_suggestions() -> None:
    environment = os.environ | {
        "_ROSIDL_PY_COMPLETE": "bash_complete",
        "COMP_WORDS": "rosidl-py topic echo --field ",
        "COMP_CWORD": "4",
    }
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert (done.stdout.strip(), done.stderr) == ("", "")


def test_generator_ends_quietly_if_the_reader_of_its_output_has_ended() -> None:
    text = f"{shlex.quote(sys.executable)} -m rosidl_py_gen.generator_cli --list | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", text], capture_output=True, text=True, timeout=60)
    assert done.stderr == "" and done.stdout in ("141\n", "0\n")


def test_multi_line_errors_keep_lines_and_escape_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        ros_cli.main(["topic", "type", "/a b", "--discovery", "off"])
    assert end.value.code == 1
    assert capsys.readouterr().err.endswith(" are\n    /a b\n      ^\n")
    report("a peer says \x1b[2J\nerror: b")
    assert capsys.readouterr().err == "error: a peer says \ufffd[2J\\nerror: b\n"


LOADED = {
    "help and completion load neither the runtime nor rich": (
        "import sys, click; from rosidl_py_gen import ros_cli\n"
        "def load(group):\n"
        "    for name in group.list_commands(None):\n"
        "        command = group.get_command(None, name)\n"
        "        if isinstance(command, click.Group): load(command)\n"
        "ours = ['rosidl_py_gen.' + name for name in ('runtime', 'bags', 'compiler', 'tables')]\n"
        "load(ros_cli.root())\n"
        "print([name for name in (*ours, 'rich', 'yaml', 'numpy', 'asyncio', 'matplotlib') if name in sys.modules])",
        "[]",
    ),
    "a command does not load the others of its group": (
        "import sys; from rosidl_py_gen.ros_cli import main\n"
        "try: main(['bag', 'table', '--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted(name for name in sys.modules if name.startswith('rosidl_py_gen.ros_cli.bag.')))",
        "['rosidl_py_gen.ros_cli.bag.tables']",
    ),
    "numpy and the node are loaded while the context listens": (
        "import sys; from rosidl_py_gen.command_support import command_node\n"
        "import rosidl_py_gen.ros_cli.topic.info, rosidl_py_gen.ros_cli.graph\n"
        "print([name for name in ('rosidl_py_gen.runtime.node.node', 'numpy') if name in sys.modules])",
        "[]",
    ),
}


@pytest.mark.parametrize("what", LOADED)
def test_commands_load_modules_lazily(what: str) -> None:
    code, loaded = LOADED[what]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == loaded


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_command_succeeds_with_closed_standard_streams(closed: str) -> None:
    command = f"{sys.executable} -m rosidl_py_gen.ros_cli topic list --discovery localhost {closed}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    notes = [line for line in done.stderr.splitlines() if not line.startswith("no nodes were found in domain")]
    assert (done.returncode, notes) == (0, [])


def _commands(group: click.Group, context: click.Context) -> Iterator[click.Command]:
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from _commands(command, context)
        else:
            yield command


ROOT = ros_cli.root()
# A command retains the help option of the first context that asks for it, so each context here has the names of ours.
CONTEXT = click.Context(ROOT, **ROOT.context_settings)
COMMANDS = [*_commands(ROOT, CONTEXT)]


def test_every_command_help_has_example_and_node_commands_accept_no_daemon() -> None:
    for command in COMMANDS:
        context = click.Context(command, CONTEXT, command.name, max_content_width=200)
        text = command.get_help(context)
        assert "RANGE" not in text.replace("DISCOVERY_RANGE", ""), command.name
        assert re.search(rf"rosidl-py (\w+ )?{command.name}\b", text), command.name
        names = {name for parameter in command.params for name in parameter.opts}
        assert ("--domain" in names) == ("--no-daemon" in names), command.name
        shows_itself = {"completion", "demo", "launch", "play", "plot", "sql", "test", "zenoh-router"}
        assert "--json" in names or command.name in shows_itself, command.name


def test_topics_option_takes_several_values_in_bag_commands() -> None:
    group = ROOT.get_command(CONTEXT, "bag")
    assert isinstance(group, click.Group)
    for words, topics, others in [
        ("record --topics /a /b", "more_topics", {"topics": ()}),
        ("play bag --topics /a /b", "topics", {"path": "bag"}),
        ("convert --topics /a bag out --topics /b", "topics", {"path": "bag", "output": "out"}),
        ("convert --topics /a /b -- bag out", "topics", {"path": "bag", "output": "out"}),
        ("play --topics /a /b --rate 2 -- bag", "topics", {"path": "bag", "rate": 2.0}),
        ("play --topics /a --topics /b bag --clock", "topics", {"path": "bag"}),
        ("play --rate=2 bag --topics=/a --topics /b", "topics", {"path": "bag", "rate": 2.0}),
        ("play -i bag --topics /a /b -s mcap --disable-loan-message", "topics", {"inputs": ("bag",)}),
        ("convert bag out --topics /a /b --duration 3", "topics", {"duration_s": 3.0}),
        ("table bag1 bag2 --topics /a /b --out x", "topics", {"bags": ("bag1", "bag2"), "out": "x"}),
        ("table --topics /a bag1 --topics /b -o x", "topics", {"bags": ("bag1",), "out": "x"}),
        ("migrate bag --topics /a /b --path new", "topics", {"path": "bag", "paths": ("new",)}),
    ]:
        name, *rest = words.split()
        command = group.get_command(CONTEXT, name)
        assert command is not None
        found = command.make_context(name, rest, CONTEXT).params
        assert found[topics] == ("/a", "/b"), words
        assert others.items() <= found.items(), words


@pytest.mark.parametrize("command", COMMANDS, ids=lambda one: f"{one.callback.__module__.split('.')[-1]}.{one.name}")
def test_click_parameters_match_signature_of_command_function(
    command: click.Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = click.Context(command, CONTEXT)
    for parameter in command.params:
        if parameter.expose_value:
            context.params[parameter.name or ""] = "given"
        else:  # it hands on a value by itself, as `network` and `qos`
            assert parameter.callback is not None
            parameter.callback(context, parameter, None)
    assert command.callback is not None
    function = inspect.unwrap(command.callback)
    signature = inspect.signature(function)
    kinds = {one.kind for one in signature.parameters.values()}
    if hasattr(getattr(command.callback, "__wrapped__", None), "__wrapped__"):  # `options.node_verb`
        context.params["command_node"] = context.params.pop("network")
    signature.bind(**context.params)
    if inspect.Parameter.VAR_KEYWORD in kinds and command.name not in ("launch", "play"):  # which check values
        for does in (
            "ros_cli.playback.player.play_bag",
            "ros_cli.recording.recorder.record_bag",
            "foxglove.serve.serve",
        ):
            monkeypatch.setattr(f"rosidl_py_gen.{does}", lambda network, options: None)
        made = function(**context.params)  # what several commands share takes its arguments now
        main = made.main if isinstance(made, ros_cli.AsyncCommand) else made
        if main is not None:
            main.close()


def offered(line: str, *options: str) -> list[str]:
    """Return the completions of the last word of a command line; options are inserted after the command."""
    *words, incomplete = line.split(" ")
    place = 1 if words[:1] == ["graph"] else 2
    words[place:place] = options
    complete = BashComplete(ROOT, {}, "rosidl-py", "_ROSIDL_PY_COMPLETE")
    return [item.value for item in complete.get_completions(words, incomplete)]


async def test_completion_offers_names_types_and_fields_of_live_graph(dds: World) -> None:
    node, other = dds.node("base"), dds.node("pilot")
    node.create_publisher(String, "/speed")
    node.create_publisher(String, "/_secret")
    node.create_service(Trigger, "/stop", lambda request: Trigger.Response())
    node.create_action_server(get_action("example_interfaces/action/Fibonacci"), "/drive", lambda goal: None)
    node.declare_parameter("max_speed", 1.0)
    await until(lambda: other.count_services("/drive/_action/get_result") == 1)
    other.create_publisher(get_message("nav_msgs/msg/Odometry"), "/odom")
    position = "pose.pose.position"
    cases = {
        "topic echo /s": ["/speed"],
        "topic echo /_": ["/_secret"],
        "service call /st": ["/stop"],
        "topic plot /odom twist.twist.": ["twist.twist.linear", "twist.twist.angular"],
        "graph --node /": ["/base", "/pilot"],
        "bag record --topics /rosout /sp": ["/speed"],
        "bag record --all --exclude-actions /other /": ["/drive"],
        "action info /": ["/drive"],
        "param get base max": ["max_speed"],
        "param get /nobody max": [],
        "topic pub /odom ": ["nav_msgs/msg/Odometry"],
        "topic pub /odom std_msgs/msg/Strin": ["std_msgs/msg/String"],  # a type that no node announces
        "service call /stop std": ["std_srvs/srv/Trigger"],
        "action send_goal /drive ": ["example_interfaces/action/Fibonacci"],
        "topic echo /odom --field pose.pose.pos": [position, *(f"{position}.{axis}" for axis in "xyz")],
        "topic echo /odom --field nothing.": [],
    }
    found = await asyncio.gather(*(asyncio.to_thread(offered, line, "--spin-time", "3") for line in cases))
    assert dict(zip(cases, found, strict=True)) == cases
    assert not any("_action" in name for name in await asyncio.to_thread(offered, "topic echo /", "--spin-time", "3"))


def test_completion_of_local_packages_and_bags_needs_no_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace, file = tmp_path / "ws", tmp_path / "a.mcap"
    files = {"robot/package.xml": PACKAGE_XML.format("robot"), "robot/launch/up.launch.py": "", "robot/x.py": ""}
    write(workspace, files)
    with BagWriter(file) as bag:
        for topic in ("/imu", "/odom"):
            bag.write(topic, String(data="x"), log_time_ns=1)
    monkeypatch.setenv("ROS_DOMAIN_ID", "junk")
    cases = {
        "interf": ["interface"],
        "graph --f": ["--format"],
        "graph --format ": ["text", "mermaid", "svg", "json"],
        "interface show geometry_msgs/msg/PoseS": ["geometry_msgs/msg/PoseStamped"],
        "interface package geo": ["geometry_msgs"],
        f"launch --path {workspace} robo": ["robot", ""],
        f"launch --path {workspace} robot ": ["up.launch.py"],
        f"launch --path {workspace} robot up.launch.py ": [],
        f"launch --path {workspace} nobody ": [],
        "topic pub /a std_msgs/msg/ColorRGBA ": ["{r: 0.0, g: 0.0, b: 0.0, a: 0.0}"],
        "topic pub /a std_msgs/msg/String ": ["{data: ''}"],
        "service call /a std_srvs/srv/SetBool ": ["{data: false}"],
        "action send_goal /a example_interfaces/action/Fibonacci ": ["{order: 0}"],
        "topic pub /a std_msgs/msg/String {} ": [],
        "topic echo /a geometry_msgs/msg/PoseArray --field poses": [
            *("poses", "poses[0].position", "poses[0].orientation")
        ],
        "topic echo /a geometry_msgs/msg/PoseArray --field poses[3].position.": [
            *(f"poses[3].position.{axis}" for axis in "xyz")
        ],
        "service find std_srvs/srv/T": ["std_srvs/srv/Trigger"],
        "action find example_interfaces/action/F": ["example_interfaces/action/Fibonacci"],
        "interface show std_srvs/srv/E": ["std_srvs/srv/Empty"],
        "topic echo /": [],  # nothing where nothing can be asked
        f"bag table {file} --out x --topics /": ["/imu", "/odom"],
        f"bag convert {file} out --topics /imu /o": ["/odom"],
        f"bag play {file} --topics /i": ["/imu"],
        f"bag convert {tmp_path}/missing.mcap out --topics /": [],
        f"bag plot {file} /": ["/imu", "/odom"],
        f"bag plot {file} /imu d": ["data"],
        f"bag plot {file} /imu data /o": ["/odom"],
        f"bag plot {file}": [str(file)],
    }
    assert {line: offered(line) for line in cases} == cases
    assert "robot" in offered(f"launch --path {workspace} ")
    assert {"doctor", "graph", "topic"} <= {*offered("")} and offered("") == sorted(offered(""))


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_script_is_valid_for_each_shell(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    ros_cli.main(["completion", shell])
    script = capsys.readouterr().out
    assert f"_ROSIDL_PY_COMPLETE={shell}_complete" in script
    if shutil.which(shell):
        done = subprocess.run([shell, "-n"], input=script, text=True, capture_output=True)
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_with_installed_script() -> None:
    tools_dir = Path(sys.executable).parent
    if not (tools_dir / "rosidl-py").exists():
        pytest.skip("the command is not installed beside this Python")
    lines = {
        "rosidl-py interf": "<interface>",
        "rosidl-py service call /a std_srvs/srv/SetBool ": '<"{data: false}">',
        "rosidl-py-gen --filter std_msgs:action_m": "<action_msgs>",
        "rosidl-py-gen --filter=std_ms": "<std_msgs>",
        "rosidl-py-gen interface std_msgs/msg/Strin": "<std_msgs/msg/String>",
    }
    script = 'eval "$(rosidl-py completion bash)"; eval "$(rosidl-py-gen completion bash)"; ' + "".join(
        f"COMPREPLY=(); COMP_LINE={shlex.quote(line)}; COMP_POINT=${{#COMP_LINE}}; "
        f"_{line.split()[0].replace('-', '_')}_completion {line.split()[0]}; "
        'printf "<%s>" "${COMPREPLY[@]}"; echo; '
        for line in lines
    )
    path = os.pathsep.join([str(tools_dir), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-c", script], env={**os.environ, "PATH": path}, capture_output=True, text=True, cwd="/"
    )
    assert (dict(zip(lines, done.stdout.splitlines(), strict=True)), done.stderr) == (lines, "")


def test_completion_quotes_names_of_peers_for_shells(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["/a$(touch x)", "/a`touch x`", "/a;x", "/a b", "/a*", "/a\nplain,/b", "/a\x1b[31m", "/a'b"]

    @click.command()
    @click.option("--topic", shell_complete=lambda ctx, param, incomplete: shells.items(names, incomplete))
    def command(topic: str) -> None: ...

    shells.install_completion()
    monkeypatch.setenv("COMP_WORDS", "x --topic /a")
    monkeypatch.setenv("COMP_CWORD", "2")
    quoted = ["'/a$(touch x)'", "'/a`touch x`'", r"/a\;x", '"/a b"', r"/a\*", r"/a\'b"]
    for shell, expected in (
        ("bash", [f"plain,{name}" for name in quoted]),
        ("zsh", [line for name in quoted for line in ("plain", name, "_")]),
    ):
        maker = get_completion_class(shell)
        assert maker is not None
        assert maker(command, {}, "x", "_X_COMPLETE").complete().split("\n") == expected
    assert [shlex.split(name) for name in quoted] == [[name] for name in names if name.isprintable()]


def parameters_with_completion() -> dict[str, tuple[click.Context, click.Parameter]]:
    """Return all parameters of both command lines that complete their value, by command and name."""
    found: dict[str, tuple[click.Context, click.Parameter]] = {}
    waiting = [click.Context(ROOT, info_name="rosidl-py"), click.Context(generator, info_name="rosidl-py-gen")]
    for context in waiting:  # grows inside the loop
        command = context.command
        for one in command.params:
            if one._custom_shell_complete is not None:
                found[f"{context.command_path} {one.name}"] = (context, one)
        if isinstance(command, click.Group):
            commands = {name: command.get_command(context, name) for name in command.list_commands(context)}
            waiting += [click.Context(one, context, name) for name, one in commands.items() if one is not None]
    return found


HOSTILE: dict[str, Any] = {
    "nothing": {},
    "None": None,
    "numbers": 7,
    "objects": object(),
    "texts": "\0\udc80",
    "long texts": ("x" * 100_000,),
    "lists": ["/a", None, 1],
    "words of a topic": ("/a",),
    "empty words": ("", ""),
}


@pytest.mark.parametrize("values", HOSTILE.values(), ids=HOSTILE.keys())
def test_completion_never_raises_for_invalid_parameters(
    values: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "junk")  # nodes do not start
    monkeypatch.chdir(tmp_path)
    found = parameters_with_completion()
    assert len(found) > 60
    names = {one.name for context, _ in found.values() for one in context.command.params if one.name}
    for context, parameter in found.values():
        context.params = {} if values == {} else dict.fromkeys(names | {"paths", "words", "network", "topic"}, values)
        for incomplete in ("", "/", "a.b[", "\0"):
            items = parameter.shell_complete(context, incomplete)
            assert isinstance(items, list) and all(isinstance(one.value, str) for one in items)


@pytest.mark.parametrize(
    "words",
    [
        "topic echo --field ",
        "topic echo --field a.b",
        "param get  ",
        "topic pub --qos-profile x ",
        "bag play  --topics ",
    ],
)
def test_failing_completion_prints_no_errors(words: str) -> None:
    """Options may precede the arguments that their completion needs."""
    line = f"rosidl-py {words}"
    environment = {"_ROSIDL_PY_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_LINE": line, "COMP_CWORD": "9"}
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli"]
    settings = {**os.environ, "ROS_DOMAIN_ID": "junk", **environment}
    done = subprocess.run(command, env=settings, capture_output=True, text=True)
    assert done.stderr == "" and "Traceback" not in done.stdout
