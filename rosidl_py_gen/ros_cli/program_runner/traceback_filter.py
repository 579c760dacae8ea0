"""What is shown of an exception that ends a program: what helps its author.

Decides which frames of a Ctrl-C are hidden, those below a call of rclpy, and which missing module is a message package.
Nothing of other exceptions is hidden, so that errors of ours are seen.
"""

from __future__ import annotations

import linecache
import re
import sysconfig
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from rosidl_py_gen.base.names import KINDS, did_you_mean
from rosidl_py_gen.runtime import RosArgumentError
from rosidl_py_gen.type_loading.import_hook import RCLPY_COMPAT_DIR, found_packages

_OURS = str(Path(__file__).parents[2])
_HANDLER = str(RCLPY_COMPAT_DIR / "rclpy" / "signals.py")
_STDLIB = sysconfig.get_path("stdlib")
_KINDS = "|".join(KINDS)
_MESSAGE_PACKAGE_NAME = re.compile(r"\w+_(msgs?|srvs|interfaces)")


def filter_traceback(error: BaseException) -> None:
    """Change the exception into what is to be printed."""
    if isinstance(error, KeyboardInterrupt):
        error.__traceback__ = _of_the_program(error.__traceback__)
    elif isinstance(error, ModuleNotFoundError) and error.name is not None:
        package = error.name.partition(".")[0]
        if _is_of_messages(error.name, error.__traceback__):
            _add_note(error, _hint(package))


def refused_arguments(error: BaseException) -> str:
    """Return the text for a user whose ROS arguments or parameter file ended the program; empty for other errors.

    A program that then cleans up often fails a second time, because nothing was initialized. That error is left out.
    """
    seen: set[int] = set()
    one: BaseException | None = error
    while one is not None and id(one) not in seen:
        seen.add(id(one))
        if isinstance(one, RosArgumentError) or getattr(one, "is_of_initial_value", False):
            return str(one)
        one = one.__cause__ or one.__context__
    return ""


def _of_the_program(traceback: TracebackType | None) -> TracebackType | None:
    """The program's frames, and of those of ours between or below them the first, which it called."""
    kept: list[TracebackType] = []
    is_inside = False
    for one in _entries(traceback):
        file = one.tb_frame.f_code.co_filename
        if file.startswith(_OURS):
            if not is_inside and file != _HANDLER:
                kept.append(one)
            is_inside = True
        elif not is_inside or not _is_of_python(file):
            kept.append(one)
            is_inside = False
    for one, following in zip(kept, [*kept[1:], None], strict=True):
        one.tb_next = following
    return kept[0] if kept else traceback


def _entries(traceback: TracebackType | None) -> Iterator[TracebackType]:
    while traceback is not None:
        following = traceback.tb_next
        yield traceback
        traceback = following


def _is_of_python(file: str) -> bool:
    return file.startswith("<frozen ") or (file.startswith(_STDLIB) and "site-packages" not in file)


def _is_of_messages(module: str, traceback: TracebackType | None) -> bool:
    """Whether a module that is not there is a message package, by its name or by the line that imports it."""
    package, _, rest = module.partition(".")
    if rest in KINDS or _MESSAGE_PACKAGE_NAME.fullmatch(package):
        return True
    asked = re.compile(rf"\b{re.escape(package)}(\.|\s+import\s+)({_KINDS})\b")
    lines = (linecache.getline(one.tb_frame.f_code.co_filename, one.tb_lineno) for one in _entries(traceback))
    return any(asked.search(line) for line in lines)


def _hint(package: str) -> str:
    found = found_packages()
    if package in found:
        return f"{package} is a package in {found[package].folder}, which defines no such messages."
    text = f'There is no message package "{package}"{did_you_mean(package, found)}'
    end = "" if text.endswith("?") else "."
    return (
        f"{text}{end} If its definitions are on this machine, name the folder of the package, or of the workspace that "
        "has it: rosidl-py run --path FOLDER ..."
    )


def _add_note(error: ImportError, text: str) -> None:
    if hasattr(error, "add_note"):
        error.add_note(text)
    else:  # Python 3.10
        error.msg = f"{error.msg}\n{text}"
