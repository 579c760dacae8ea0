"""Time and memory that `rosidl-py prefix` takes for small packages that ask for much."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from support.interface_packages import write

resource = pytest.importorskip("resource")
pytestmark = [
    pytest.mark.real_time("measures the time of processes"),
    pytest.mark.skipif(os.name == "nt", reason="there is no prefix"),
]
MAX_CPU_S = 4.0
MAX_BYTES = 200 << 20
IMPORTS = """
import fnmatch, itertools, os
from glob import glob
from pathlib import Path
from setuptools import find_packages, setup
rows = []
"""
END = "\nsetup(name='p', version='1', packages=['p'], data_files=rows)\n"
SETUP_PY = {
    "sum": "a = 'xxxxxxxxxxxxxxxx'\n" + "a = a + a\n" * 40,
    "f-string": "a = 'x'\n" + "a = f'{a}{a}'\n" * 60,
    "percent": "a = 'x'\n" + "a = '%s%s' % (a, a)\n" * 60,
    "format": "a = 'x'\n" + "a = '{0}{0}{0}'.format(a)\n" * 60,
    "join": "a = 'xx'\n" + "a = a.join([a] * 9)\n" * 60,
    "replace": "a = 'xx'\n" + "a = a.replace('x', a)\n" * 60,
    "product": "a = 'x' * 10000000000\nrows = [('share/p', ['f'])] * 1000000000",
    "list added to itself": "rows = [('share/p', ['f'])]\n" + "rows += rows\n" * 60,
    "list of lists": "rows = ['x']\n" + "rows = [rows, rows]\n" * 60,
    "list in itself": "rows.append(rows)",
    "loop over itself": "rows.append(1)\nfor one in rows:\n    rows.append(one)",
    "loop": "for one in range(1000000000):\n    for other in range(1000000000):\n        pass",
    "endless loop": "while True:\n    pass",
    "recursion": "def f(n):\n    return f(n) + f(n) + f(n) + f(n) + f(n) + f(n)\nrows = f(1)",
    "paths": "a = Path('a/b')\n" + "a = a / a\n" * 60,
    "dicts": "a = {'x': []}\nfor one in range(1000000):\n    a = {**a, f'{one}': a}",
    "comparison": "a = ['x']\n" + "a = [a, a]\n" * 60 + "b = a == a",
    "patterns": "for one in range(1000000):\n    fnmatch.fnmatch('a' * 200, f'{one}' + '*a' * 500)",
    "glob in a loop": "for one in range(1000000):\n    rows += [('x', glob('*'))]",
    "packages in a loop": "for one in range(1000000):\n    find_packages(exclude=['*a*' * 100] * 1000)",
    "number in a range": "for one in range(1000):\n    b = 'x' in range(1000000000)\n    c = 5.5 in range(1000000000)",
    "long names and patterns": "fnmatch.fnmatch('a' * 500000, '*' + 'a' * 12000 + 'b')",
    "generators": "rows = [(y for y in ()) for n in range(100000000)]",
    "iterators with a doubt": "a = [1] * 1000\nfor one in unknown:\n    a = map(str, a)\n    list(a)\n" * 300,
    "words": "a = 'a ' * 20000\nfor one in range(1000000):\n    rows.append(a.split())",
    "unknown calls": "rows = [[] for _ in range(5000)]\nfor one in range(100000):\n    unknown(rows)",
    "numbers": "a = 9 ** 9 ** 9 ** 9\nb = 1 << 1000000000000\nc = 1000000000000\n" + "c = c * c\n" * 60 + "a = str(c)",
    "long number": f"version = 0x{'9' * 100_000}\nversion = f'{{version}}'",
    "rows": "rows = [(f'share/p/{one}', ['setup.py']) for one in range(20000)]",
    "deep rows": "rows = [(f'share/p/{one}/' + 'a/' * 2000, ['setup.py']) for one in range(2000)]",
    "files of a row": "rows = [('share/p', ['setup.py'] * 100000)]",
    "syntax tree": "a = [" + "a," * 60_000 + "]",
    "too long": "a = [" + "0," * 500_000 + "]",
    "brackets": "a = " + "[" * 60_000,
    "signs": "a = " + "-" * 60_000 + "1",
    "attributes": "a = os" + ".x" * 30_000,
    "entry points": "setup(name='p', entry_points={'console_scripts': [f'n{n} = p:m' for n in range(100000)]})",
    "malformed entry points": "setup(name='p', entry_points={'console_scripts': [f'n{n} p' for n in range(100000)]})",
}
OTHER_FILES: dict[str, dict[str, str]] = {
    "blank lines": {"setup.cfg": "\n" * 60_000},
    "spaces": {"setup.cfg": "[a]\nb" + " " * 900_000 + "c\n"},
    "lines without a value": {"setup.cfg": "[a]\n" + "b\n" * 400_000},
    "patterns": {"setup.cfg": "[options.data_files]\nshare/p=\n" + " **/**/**/*x\n" * 50_000},
    "console scripts": {"setup.cfg": "[options.entry_points]\nconsole_scripts=\n" + " a=b:c\n" * 120_000},
    "versions": {"package.xml": "<package><name>pack</name>" + "<version" * 40_000 + "</package>"},
    "comments": {"package.xml": "<package><name>pack</name>" + "<!--" * 200_000},
    "spaces of a name": {"package.xml": "<package><name>" + " " * 900_000},
    "names": {"package.xml": "<package>" + "<name>" * 150_000 + " " * 90_000},
    "parts of a key": {"pyproject.toml": ".".join(["a"] * 30_000) + "=1"},
    "parts of keys": {"pyproject.toml": "\n".join(f"b{n}." + ".".join(["a"] * 290) + "=1" for n in range(100))},
    "nested values": {"pyproject.toml": "a=" + "[" * 60_000},
    "Python packages": {
        "CMakeLists.txt": "ament_python_install_package(p SCRIPTS_DESTINATION lib/pack)\n" * 20,
        "setup.py": IMPORTS + "for one in range(1000000):\n    x = [one]\nsetup(name='p', version='1')",
    },
    "includes": {"CMakeLists.txt": "include(a.cmake)\n", "a.cmake": "include(" * 100_000},
    "long word": {"CMakeLists.txt": "include(a.cmake)\n", "a.cmake": "a" * 900_000},
    "long word in a loop": {"CMakeLists.txt": f"foreach(i ${{L}})\nfoo({'a' * 900_000})\nendforeach()\n"},
    "resources": {"CMakeLists.txt": "".join(f"ament_index_register_resource(r{n})\n" for n in range(15_000))},
    "plugins": {
        "CMakeLists.txt": "".join(f"pluginlib_export_plugin_description_file(a x{n}.xml)\n" for n in range(12_000))
    },
}


def _links(folder: Path) -> None:
    for here in range(8):
        (folder / f"d{here}").mkdir()
        for other in range(8):
            (folder / f"d{here}/l{other}").symlink_to(f"../d{other}")


def _links_to_itself(folder: Path) -> None:
    for name in "ab":
        (folder / name).symlink_to(".")
        (folder / "p" / name).symlink_to(".")


def _deep_folders(folder: Path) -> None:
    here = os.getcwd()
    try:
        os.chdir(folder)
        for _ in range(300):
            os.mkdir("a")
            os.chdir("a")
    finally:
        os.chdir(here)


def _many_names(folder: Path) -> None:
    write(folder, {f"m/f{number}": "" for number in range(100)})
    for name in ("l", "k"):
        (folder / "m" / name).symlink_to(".")


LINKS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "stars": ("rows = [('x', glob('*/*/*/*/*/*/*/*/*/*'))]", _links),
    "two stars": ("rows = [('x', glob('**/*/**/*/**/*', recursive=True))]", _links),
    "links to itself": ("rows = [('x', glob('" + "*/" * 22 + "zzz'))]", _links_to_itself),
    "packages": ("rows = [('x', find_packages())]", _links_to_itself),
    "pathlib": ("rows = [('x', [str(one) for one in Path('.').glob('*/*/*/*/*/*/*/*/*')])]", _links),
    "the root": (
        "rows = [('x', glob('**/zzz', recursive=True) + glob('r/*') + os.listdir('r') + list(Path('r').rglob('*')))]",
        lambda folder: (folder / "r").symlink_to("/"),
    ),
    "names of folders by links": (
        "def below(place, depth):\n    for name in ('l', 'k') if depth else ():\n        os.listdir(place)\n"
        "        below(f'{place}/{name}', depth - 1)\nbelow('m', 9)\nrows = [('x', glob('m/*/*/*/*/*/*/*/*/f1'))]\n"
        "for one in range(100000000):\n    x = [one]",
        _many_names,
    ),
    "deep folders": ("rows = [('x', glob('**/**/**/*', recursive=True) + [*os.walk('.')])]", _deep_folders),
}


_MEASURE = """
import json, resource, subprocess, sys
limits = lambda: resource.setrlimit(resource.RLIMIT_CPU, (10, 10))
done = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, preexec_fn=limits)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
sys.stdout.write(done.stdout.decode())
print("\\n" + json.dumps([done.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss]), end="")
"""
"""Runs a command and prints its status, CPU time in s and memory in KiB.

A small process of its own starts the command: Linux counts the memory of the process that starts a command as its own.
"""


def check(package: Path) -> str:
    """Make a prefix; return the lines of the command, which must end within the limits of time and memory."""
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "prefix", str(package), "--out", str(package / "../out")]
    done = subprocess.run([sys.executable, "-c", _MEASURE, *command], capture_output=True, text=True, check=True)
    text, _, figures = done.stdout.rpartition("\n")
    status, cpu_s, kib = json.loads(figures)
    assert status in (0, 1) and "Traceback" not in text, text[-2000:]
    assert cpu_s <= MAX_CPU_S
    assert kib * 1024 <= MAX_BYTES
    assert len(text) < 10_000
    return text


def write_package(folder: Path, files: dict[str, str]) -> Path:
    base = {"package.xml": "<package><name>pack</name><version>1.0.0</version></package>", "p/__init__.py": "", "f": ""}
    write(folder / "pack", {**base, **files})
    return folder / "pack"


@pytest.mark.parametrize("case", SETUP_PY)
def test_setup_py_takes_bounded_time_and_memory(case: str, tmp_path: Path) -> None:
    package = write_package(tmp_path, {"setup.py": IMPORTS + SETUP_PY[case] + END})
    check(package)
    assert (tmp_path / "out/share/pack/package.xml").is_symlink()


@pytest.mark.parametrize("case", OTHER_FILES)
def test_other_files_take_bounded_time_and_memory(case: str, tmp_path: Path) -> None:
    files = OTHER_FILES[case]
    setup = {} if "CMakeLists.txt" in files else {"setup.py": IMPORTS + "setup(name='p', version='1')"}
    check(write_package(tmp_path, {**setup, **files}))
    assert (tmp_path / "out/share/pack/package.xml").is_symlink()


@pytest.mark.parametrize("case", LINKS)
def test_links_and_deep_folders_take_bounded_time_and_are_reported(case: str, tmp_path: Path) -> None:
    code, make = LINKS[case]
    package = write_package(tmp_path, {"setup.py": IMPORTS + code + END})
    make(package)
    assert "setup.py are not known without running it" in check(package) or case == "deep folders"


def test_a_usual_package_stays_far_below_the_limits(tmp_path: Path) -> None:
    code = """
for place, _, files in os.walk("models"):
    for name in files:
        path = os.path.join(place, name)
        if os.path.isfile(path) and not path.endswith(".bak"):
            rows.append((os.path.join("share", "pack", place), [path]))
"""
    models = {f"models/m{n % 50}/mesh{n}.stl": "" for n in range(4000)}
    package = write_package(tmp_path, {"setup.py": IMPORTS + code + END, **models})
    assert check(package).startswith(str(tmp_path / "out")) or "1 package, 40" in check(package)
    assert len([*(tmp_path / "out/share/pack/models").rglob("*.stl")]) == 4000


def test_many_modules_and_unknown_data_files_take_bounded_time(tmp_path: Path) -> None:
    code = "setup(name='p', version='1', py_modules=[f'm{n}' for n in range(4000)], data_files=unknown())"
    files = {f"m{n}.py": "" for n in range(4000)} | {f"models/mesh{n}.stl": "" for n in range(4000)}
    package = write_package(tmp_path, {"setup.py": IMPORTS + code, **files})
    assert "setup.py are not known without running it" in check(package)
    assert len([*(tmp_path / "out/share/pack/models").iterdir()]) == 4000
