"""Running a program as `python` does: `__main__`, `sys.argv`, `sys.path`, exit code, traceback and signals."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType, TracebackType
from typing import Any

from rosidl_py_gen.ros_cli import CommandError, report
from rosidl_py_gen.ros_cli.program_runner.error_display import filter_traceback, refused_arguments

_PACKAGE_DIR = str(Path(__file__).parents[1])


@dataclass(frozen=True)
class Program:
    """Script, module, or function of a console script, with its arguments.

    Attributes:
        name: `sys.argv[0]`.
        arguments: the other elements of `sys.argv`.
        folder: first folder of `sys.path`.
        place: the script, or a folder, in the workspace of the program.
        file: the script, or None.
        module: the module that becomes `__main__` or has the function; None for a script.
        function: the function of a console script, with dots for attributes, or None.
    """

    name: str
    arguments: tuple[str, ...]
    folder: str
    place: Path
    file: Path | None = None
    module: str | None = None
    function: str | None = None

    def start(self) -> None:
        """Run the program; it ends with its exit code, an exception whose traceback was printed, or a signal."""
        sys.path[:1] = [self.folder]
        sys.argv[:] = [self.name, *self.arguments]
        try:
            self._body()()
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

    def _body(self) -> Callable[[], Any]:
        if self.function is not None:
            return self._console_script
        if self.module is not None:
            spec = _spec(self.module)
            code = _code(spec)
            sys.argv[0] = spec.origin or self.name
            main = _main_module(spec.loader, spec.origin, spec)
        else:
            assert self.file is not None
            path = os.path.abspath(self.file)
            loader = SourceFileLoader("__main__", path)
            code = loader.source_to_code(loader.get_data(path), path)
            main = _main_module(loader, path, None)
        return lambda: exec(code, main.__dict__)

    def _console_script(self) -> None:
        assert self.module is not None and self.function is not None
        main = _main_module(None, None, None)
        function: Any = importlib.import_module(self.module)
        for name in self.function.split("."):
            function = getattr(function, name)
        main.__dict__[self.function.rpartition(".")[2]] = function
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
    """Return the spec of the module for ``-m``; of a package that of its `__main__`."""
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


def _code(spec: ModuleSpec) -> CodeType:
    get = getattr(spec.loader, "get_code", None)
    code = get(spec.name) if get is not None else None
    if not isinstance(code, CodeType):
        raise CommandError(f'the module "{spec.name}" has no code to run')
    return code


def _without_own_frames(traceback: TracebackType | None) -> TracebackType | None:
    while traceback is not None:
        file = traceback.tb_frame.f_code.co_filename
        if not file.startswith((_PACKAGE_DIR, "<frozen importlib")) and file != importlib.__file__:
            break
        traceback = traceback.tb_next
    return traceback
