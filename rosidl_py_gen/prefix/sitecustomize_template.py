"""Module ``sitecustomize`` of a prefix: makes rclpy, its companions and message packages importable in every Python
process.

Written by rosidl-py prefix. Python imports this module when it starts; the import hook is installed by the first import
of such a package. Another module of this name is imported, too.
"""

from __future__ import annotations

import os
import sys

_NAMES: frozenset[str] = frozenset(())
_HOOK = "rosidl_py_gen.type_loading.import_hook"


class _HookInstaller:
    """Import finder that installs the import hook at the first import that needs it, and passes on what the
    hook finds.
    """

    def find_spec(self, fullname, path=None, target=None):  # type: ignore[no-untyped-def]
        if fullname.partition(".")[0] not in _NAMES or any(type(one).__module__ == _HOOK for one in sys.meta_path):
            return None
        try:
            from rosidl_py_gen import install_import_hook
        except ModuleNotFoundError as error:
            if error.name != "rosidl_py_gen":
                raise
            from importlib.machinery import PathFinder

            if PathFinder.find_spec(fullname, path) is not None:
                return None  # this Python has another ROS
            text = f"{sys.executable} has no rosidl-py-gen, which provides {fullname}; use the Python that has it"
            raise ModuleNotFoundError(text, name=fullname) from None
        if self in sys.meta_path:
            sys.meta_path.remove(self)
        install_import_hook(message_api="rclpy", override_installed=True)
        sys.excepthook = _print_error
        return sys.meta_path[0].find_spec(fullname, path, target)


def _print_error(kind, error, traceback):  # type: ignore[no-untyped-def]
    """Print an exception that ends the program.

    For Ctrl-C, frames inside rclpy are omitted, as by rosidl-py run.
    """
    if issubclass(kind, KeyboardInterrupt):
        from importlib import import_module

        import_module("rosidl_py_gen.program_runner.program").filter_traceback(error)
    sys.__excepthook__(kind, error, error.__traceback__)


def _run_next() -> None:
    """Run the module `sitecustomize` that this module hides, such as the module of the operating system."""
    here = os.path.dirname(os.path.abspath(__file__))
    for folder in sys.path:
        file = os.path.join(folder, "sitecustomize.py")
        if os.path.abspath(folder) != here and os.path.isfile(file):
            from importlib.util import module_from_spec, spec_from_file_location  # slow to import

            spec = spec_from_file_location("sitecustomize", file)
            if spec is not None and spec.loader is not None:
                spec.loader.exec_module(module_from_spec(spec))
            return


sys.meta_path.insert(0, _HookInstaller())
_run_next()
