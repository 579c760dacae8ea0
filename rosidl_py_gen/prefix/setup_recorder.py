"""Program that runs the setup.py of the current folder with a `setup` that records its arguments.

colcon does the same (docs/internals/protocol.md 14.3). The arguments are written as JSON to standard output; output of
setup.py goes to standard error. The program imports no module of this package. Without setuptools, a replacement
provides the names that setup.py files import.
"""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.util
import json
import os
import sys
import sysconfig
from collections.abc import Callable, Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

_FILE = "setup.py"
_NAMES = (
    *(
        "data_files",
        "packages",
        "package_dir",
        "py_modules",
        "scripts",
        "entry_points",
        "name",
        "version",
        "cmdclass",
        "options",
    ),
)
_MAX_READ = 1000
"""Maximum number of read files that are recorded; the cached result of setup.py depends on these files."""


def main() -> None:
    output = os.dup(1)
    os.dup2(2, 1)  # what setup.py prints
    folder = os.getcwd()
    own = [*(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")), os.path.dirname(__file__)]
    sys.path[0] = folder
    sys.argv = [_FILE, "install"]
    calls: list[dict[str, Any]] = []
    read: dict[str, None] = {}
    # The values are copied at the call, because setup.py may change them afterwards.
    _replace_setup(lambda **arguments: calls.append(_plain_arguments(arguments)))
    # `compile` is not reported: its file was read before.
    sys.addaudithook(lambda event, arguments: _note_file(read, event, arguments))
    with open(_FILE, "rb") as file:
        code = compile(file.read(), os.path.join(folder, _FILE), "exec", dont_inherit=True)
    module = ModuleType("__main__")
    module.__file__ = os.path.join(folder, _FILE)
    sys.modules["__main__"] = module
    try:
        exec(code, vars(module))
    except SystemExit as end:
        if not calls:
            raise SystemExit(f"setup.py ends with status {end.code} before it calls setup") from None
    except Exception:  # after the call, setuptools has installed the files
        if not calls:
            raise
    if not calls:
        raise SystemExit("setup.py does not call setup of setuptools or distutils")
    paths = [path for path in read if not path.startswith(tuple(own))][:_MAX_READ]
    result = {"calls": calls, "read": paths}
    with os.fdopen(output, "wb") as stream:
        stream.write(json.dumps(result).encode())
        stream.flush()
    os._exit(0)  # not the functions that setup.py has registered


def _note_file(read: dict[str, None], event: str, arguments: tuple[object, ...]) -> None:
    if event in ("open", "os.listdir", "os.scandir") and len(read) < 10 * _MAX_READ:
        path, mode = (*arguments, None, None)[:2]
        is_written = event == "open" and isinstance(mode, str) and not set(mode).isdisjoint("wax+")
        if isinstance(path, str | bytes) and not is_written:
            read.setdefault(os.path.abspath(os.fsdecode(path)))


def _plain_arguments(call: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _plain(call[name]) for name in _NAMES if call.get(name) is not None}


def _plain(value: Any, depth: int = 0) -> Any:
    """Convert a value to strings, lists, dicts and None; numbers become strings, other objects None."""
    if isinstance(value, str) or value is None:
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, int | float):
        return str(value)
    if depth < 10 and isinstance(value, Mapping):
        return {str(key): _plain(one, depth + 1) for key, one in value.items()}
    if depth < 10 and isinstance(value, Iterable) and not isinstance(value, bytes):
        return [_plain(one, depth + 1) for one in value]
    return None


def _replace_setup(record: Callable[..., None]) -> None:
    """Replace the function `setup` of setuptools and distutils by `record`, and provide missing modules."""
    try:
        setuptools: Any = importlib.import_module("setuptools")
    except ImportError:
        setuptools = _replacement("setuptools")
        setuptools.__version__ = "65.0.0"
        setuptools.find_packages = _find_packages
        setuptools.find_namespace_packages = lambda *arguments, **options: _find_packages(
            *arguments, **options, is_namespace=True
        )
        sys.modules["setuptools"] = setuptools
        sys.meta_path.append(_ReplacementFinder())
    setuptools.setup = record
    try:
        core: Any = importlib.import_module("distutils.core")
    except ImportError:
        sys.modules["distutils"] = _replacement("distutils")
        if not any(isinstance(one, _ReplacementFinder) for one in sys.meta_path):
            sys.meta_path.append(_ReplacementFinder())
        core = importlib.import_module("distutils.core")
    core.setup = record


class _AnyClass:
    """Base of replacements for missing classes such as `Extension` or `Command`.

    It accepts any arguments and has any attributes.
    """

    def __init__(self, *arguments: object, **words: object) -> None:
        self.__dict__.update(words)

    def initialize_options(self) -> None: ...

    def finalize_options(self) -> None: ...

    def run(self) -> None: ...


def _replacement(name: str) -> Any:
    """Return a replacement for a missing module, each attribute of which is a new class."""
    module = ModuleType(name)
    module.__path__ = []
    module.__file__ = f"<{name}>"

    def get(attribute: str) -> type:
        if attribute.startswith("__"):
            raise AttributeError(attribute)
        setattr(module, attribute, made := type(attribute, (_AnyClass,), {}))
        return made

    module.__dict__["__getattr__"] = get
    return module


class _ReplacementFinder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Import finder that provides replacements for modules of setuptools and distutils, if these do not exist."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        is_known = name.partition(".")[0] in ("setuptools", "distutils", "pkg_resources")
        return importlib.util.spec_from_loader(name, self, is_package=True) if is_known else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module: ModuleType = _replacement(spec.name)
        return module

    def exec_module(self, module: ModuleType) -> None: ...


def _find_packages(
    where: str = ".",
    exclude: Iterable[str] = (),
    include: Iterable[str] = ("*",),
    *,
    is_namespace: bool = False,
) -> list[str]:
    excluded, included = [*exclude], [*include]

    def below(place: str, above: str) -> Iterator[str]:
        for name in sorted(os.listdir(place)):
            folder = os.path.join(place, name)
            is_package = is_namespace or os.path.isfile(os.path.join(folder, "__init__.py"))
            if "." not in name and is_package and os.path.isdir(folder):
                yield above + name
                yield from below(folder, f"{above}{name}.")

    return [
        name
        for name in below(where, "")
        if any(fnmatchcase(name, pattern) for pattern in included)
        and not any(fnmatchcase(name, pattern) for pattern in excluded)
    ]


if __name__ == "__main__":
    main()
