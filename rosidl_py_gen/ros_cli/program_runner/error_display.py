"""Errors that end a program: shortened tracebacks, hints for missing message packages, refused ROS arguments.

For Ctrl-C the frames below a call of rclpy are hidden. For a missing module that is a message package, a hint is added.
Other exceptions are printed in full, so that errors of this package are visible.
"""

from __future__ import annotations

import linecache
import re
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from rosidl_py_gen.base.names import KINDS, did_you_mean
from rosidl_py_gen.runtime import RosArgumentError
from rosidl_py_gen.type_loading import import_hook
from rosidl_py_gen.type_loading.import_hook import RCLPY_COMPAT_DIR, found_packages

_PACKAGE_DIR = str(Path(__file__).parents[2])
_SIGNAL_HANDLER = str(RCLPY_COMPAT_DIR / "rclpy" / "signals.py")
_STDLIB = str(Path(linecache.__file__).parent)
_KINDS = "|".join(KINDS)
_MESSAGE_PACKAGE_NAME = re.compile(r"\w+_(msgs?|srvs|interfaces)")


def filter_traceback(error: BaseException) -> None:
    """Change the exception to the form that is printed."""
    if isinstance(error, KeyboardInterrupt):
        error.__traceback__ = _program_frames(error.__traceback__)
    elif isinstance(error, ModuleNotFoundError) and error.name is not None:
        package = error.name.partition(".")[0]
        if "git clone" in str(error):  # raised by the import hook
            for one in _entries(error.__traceback__):
                if one.tb_next is not None and one.tb_next.tb_frame.f_code.co_filename == import_hook.__file__:
                    one.tb_next = None
        elif _is_message_module(error.name, error.__traceback__):
            _add_note(error, _hint(package))


def refused_arguments(error: BaseException) -> str:
    """Return the text of an error in ROS arguments or a parameter file; empty for other errors.

    The error may be the context of another one that the clean-up of the program has raised.
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
    """Return the frames of the program, and the first one of each sequence of our frames."""
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
    """Return True if a missing module is a message package, by its name or by the line that imports it."""
    package, _, rest = module.partition(".")
    if rest in KINDS or _MESSAGE_PACKAGE_NAME.fullmatch(package):
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
