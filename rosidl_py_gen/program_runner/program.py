"""Running of a program as `python` does: `__main__`, `sys.argv`, `sys.path`, exit code, signals, and errors that end
it.

For Ctrl-C the frames below a call of rclpy are hidden. For a missing module that is a message package, a hint is added.
Other exceptions are printed in full, so that errors of this package are visible.
"""

from __future__ import annotations

import importlib
import importlib.util
import linecache
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.machinery import ModuleSpec, SourceFileLoader
from operator import attrgetter
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

from rosidl_py_gen import found_packages
from rosidl_py_gen.base.names import RosName, did_you_mean
from rosidl_py_gen.command_support import CommandError, report
from rosidl_py_gen.prefix import Executable, install_note
from rosidl_py_gen.runtime import RosArgumentError
from rosidl_py_gen.type_loading import RCLPY_COMPAT_DIR

_PACKAGE_DIR = str(Path(__file__).parents[1])
_COMMAND_DIRS = tuple(
    str(Path(_PACKAGE_DIR, one)) for one in ("ros_cli", "command_support", "prefix", "program_runner")
)
_SIGNAL_HANDLER = str(RCLPY_COMPAT_DIR / "rclpy" / "signals.py")
_STDLIB = str(Path(linecache.__file__).parent)
_KINDS = "|".join(RosName.KINDS)
_MESSAGE_PACKAGE_NAME = re.compile(r"\w+_(msgs?|srvs|interfaces)")


def start(program: Executable, arguments: Sequence[str]) -> None:
    """Run a program in this process as python does; raises SystemExit, or an exception whose traceback was printed."""
    sys.path[:1] = [str(program.folder)]
    sys.argv[:] = [program.name, *arguments]
    try:
        _body(program)()
    except SystemExit:
        raise
    except CommandError as error:  # unknown module
        report(str(error))
        sys.exit(1)
    except BaseException as error:
        if refused := refused_arguments(error):
            report(refused)
            sys.exit(1)
        # Print the traceback as the interpreter does, without our frames. The interpreter handles the rest, such as
        # the end by SIGINT.
        error.__traceback__ = _without_own_frames(error.__traceback__)
        filter_traceback(error)
        sys.excepthook(type(error), error, error.__traceback__)
        sys.excepthook = lambda kind, error, traceback: None  # it was printed
        raise


def _body(program: Executable) -> Callable[[], Any]:
    if program.function is not None:
        return partial(_run_console_script, str(program.module), program.function)
    if program.module is not None:
        spec = _spec(program.module)
        get_code = getattr(spec.loader, "get_code", None)
        if get_code is None or (code := get_code(spec.name)) is None:
            raise CommandError(f'the module "{spec.name}" has no code to run')
        sys.argv[0] = spec.origin or program.name
        main = _main_module(spec.loader, spec.origin, spec)
    else:
        assert program.file is not None
        path = os.path.abspath(program.file)
        loader = SourceFileLoader("__main__", path)
        code = loader.source_to_code(loader.get_data(path), path)
        main = _main_module(loader, path, None)
    return lambda: exec(code, main.__dict__)


def _run_console_script(module: str, name: str) -> None:
    main = _main_module(None, None, None)
    function = attrgetter(name)(importlib.import_module(module))
    main.__dict__[name.rpartition(".")[2]] = function
    sys.exit(function())


def _main_module(loader: Any, file: str | None, spec: ModuleSpec | None) -> ModuleType:
    """Replace `__main__` by a new module with the attributes that the interpreter sets."""
    main = ModuleType("__main__")
    main.__loader__ = loader
    main.__spec__ = spec
    main.__package__ = None if spec is None else spec.parent
    if file is not None:
        main.__file__ = file
        main.__dict__["__cached__"] = None if spec is None else spec.cached
    main.__dict__["__builtins__"] = sys.modules["builtins"]
    main.__annotations__ = {}
    sys.modules["__main__"] = main
    return main


def _spec(name: str) -> ModuleSpec:
    """Return the import spec of the module that ``-m`` names, or of `__main__` in a package. Raises `CommandError`."""
    try:
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.submodule_search_locations is not None:
            spec = importlib.util.find_spec(f"{name}.__main__")
            if spec is None:
                raise CommandError(f'"{name}" is a package without a module __main__, and cannot be run')
    except ModuleNotFoundError as error:
        if error.name is None or not (name == error.name or name.startswith(error.name + ".")):
            raise
        spec = None
    except ValueError as error:
        raise CommandError(f'expected the name of a module, found "{name}": {error}') from error
    if spec is None:
        raise CommandError(f'no module "{name}" in {os.getcwd()}, in the workspace, or on sys.path')
    return spec


def _without_own_frames(traceback: TracebackType | None) -> TracebackType | None:
    own = (*_COMMAND_DIRS, "<frozen importlib", importlib.__file__)
    return next((one for one in _entries(traceback) if not one.tb_frame.f_code.co_filename.startswith(own)), None)


def filter_traceback(error: BaseException) -> None:
    """Prepare an exception for printing: hide frames of rclpy for Ctrl-C, add a hint for a missing package."""
    if isinstance(error, KeyboardInterrupt):
        error.__traceback__ = _program_frames(error.__traceback__)
    elif isinstance(error, ModuleNotFoundError) and error.name is not None:
        package = error.name.partition(".")[0]
        if "git clone" in str(error):  # raised by the import hook
            import_hook = found_packages.__code__.co_filename
            for one in _entries(error.__traceback__):
                if one.tb_next is not None and one.tb_next.tb_frame.f_code.co_filename == import_hook:
                    one.tb_next = None
        elif error.name == package and (note := install_note(package)):
            _add_note(error, note)
        elif _is_message_module(error.name, error.__traceback__):
            _add_note(error, _hint(package))


def refused_arguments(error: BaseException) -> str:
    """Return the text of an error in ROS arguments or a parameter file; "" for other errors.

    Causes and contexts of the error are searched, too: clean-up code may have raised a second error.
    """
    seen: set[int] = set()
    one: BaseException | None = error
    while one is not None and id(one) not in seen:
        seen.add(id(one))
        if isinstance(one, RosArgumentError) or getattr(one, "is_of_initial_value", False):
            return str(one)
        one = one.__cause__ or one.__context__
    return ""


def _program_frames(traceback: TracebackType | None) -> TracebackType | None:
    """Return the stack frames of the program.

    Of each sequence of frames of rosidl-py-gen only the first frame is included.
    """
    frames: list[TracebackType] = []
    is_inside = False
    for one in _entries(traceback):
        file = one.tb_frame.f_code.co_filename
        if file.startswith(_PACKAGE_DIR):
            if not is_inside and file != _SIGNAL_HANDLER:
                frames.append(one)
            is_inside = True
        elif not is_inside or not _is_of_python(file):
            frames.append(one)
            is_inside = False
    for one, following in zip(frames, [*frames[1:], None], strict=True):
        one.tb_next = following
    return frames[0] if frames else traceback


def _entries(traceback: TracebackType | None) -> Iterator[TracebackType]:
    while traceback is not None:
        following = traceback.tb_next
        yield traceback
        traceback = following


def _is_of_python(file: str) -> bool:
    return file.startswith("<frozen ") or (file.startswith(_STDLIB) and "site-packages" not in file)


def _is_message_module(module: str, traceback: TracebackType | None) -> bool:
    """Return True if a missing module is of a message package, by its name or by the line that imports it."""
    package, _, rest = module.partition(".")
    if rest in RosName.KINDS or _MESSAGE_PACKAGE_NAME.fullmatch(package):
        return True
    message_import = re.compile(rf"\b{re.escape(package)}(\.|\s+import\s+)({_KINDS})\b")
    lines = (linecache.getline(one.tb_frame.f_code.co_filename, one.tb_lineno) for one in _entries(traceback))
    return any(message_import.search(line) for line in lines)


def _hint(package: str) -> str:
    packages = found_packages()
    if package in packages:
        return f"{package} is a package in {packages[package].folder}, which defines no such messages."
    text = f'There is no message package "{package}"{did_you_mean(package, packages)}'
    end = "" if text.endswith("?") else "."
    return (
        f"{text}{end} If its definitions are on this machine, pass the folder of the package or of its workspace: "
        "rosidl-py run --path FOLDER ..."
    )


def _add_note(error: ImportError, text: str) -> None:
    if hasattr(error, "add_note"):
        error.add_note(text)
    else:  # Python 3.10
        error.msg = f"{error.msg}\n{text}"
