"""``rosidl-py`` as a whole: help, how runs end."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from rosidl_py_gen import tools


def test_help_lists_the_groups(capsys: pytest.CaptureFixture[str]) -> None:
    tools.main(["--help"])
    assert "\n  topic " in capsys.readouterr().out


def test_an_unknown_command_is_a_wrong_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        tools.main(["topik"])
    assert end.value.code == 2
    assert 'did you mean "topic"?' in capsys.readouterr().err


def test_help_loads_neither_the_runtime_nor_rich() -> None:
    code = (
        "import sys; from rosidl_py_gen.tools import main\n"
        "try: main(['topic', '--help'])\n"
        "except SystemExit: pass\n"
        "print([name for name in ('rosidl_py_gen.runtime', 'rich', 'yaml', 'numpy') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_numpy_and_the_node_are_loaded_while_the_context_listens() -> None:
    code = (
        "import sys; from rosidl_py_gen.tools import session\n"
        "import rosidl_py_gen.tools.topic.list, rosidl_py_gen.tools.graph.show\n"
        "print([name for name in ('rosidl_py_gen.runtime.node.node', 'numpy') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_reader_that_has_enough_ends_a_command_quietly() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "rosidl_py_gen.tools", "interface", "list"]
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_are_no_trouble(closed: str) -> None:
    command = f"{sys.executable} -m rosidl_py_gen.tools topic list --discovery localhost {closed}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
