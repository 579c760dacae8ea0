"""Import hook for ``from x_msgs.msg import X`` without generated files.

With rclpy's API, the hook also provides `rclpy` and its companions, which are in a folder that is not on `sys.path`. An
importable package is replaced only on request; either way, a warning names the package that is not used.
"""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.base.callbacks import Registration
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.package_repositories import MessagePackage
from rosidl_py_gen.base.resources import GeneratedCode
from rosidl_py_gen.errors import DefinitionError, Diagnostic

if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.abc import Loader

    from rosidl_py_gen.type_loading.class_lookup import SearchFolders
    from rosidl_py_gen.type_loading.interface_modules import Interfaces

else:
    Loader = object  # takes 5 ms to import

_PARSER = ("rosidl_parser", "rosidl_parser.definition")
"""Names of modules with the types in `SLOT_TYPES` of rclpy's messages; the hook provides these modules if they are not
installed."""
RCLPY_COMPAT_DIR = Path(__file__).parents[1] / "ros_compat"
"""Folder of the packages that are importable with rclpy's API: `rclpy`, `tf2_ros` and others."""


class ImportHookWarning(UserWarning):
    """Warning of the import hook: of two packages with one name one is not used, or a share folder is a guess."""


@dataclass(frozen=True)
class FoundPackage:
    """ROS package that the import hook has found.

    Attributes:
        name: the package name.
        folder: the source folder, or ``share/<package>`` of an installed package.
        interfaces: files below `folder` that define messages, services and actions, such as ``msg/String.msg``.
    """

    name: str
    folder: Path
    interfaces: tuple[str, ...]

    @property
    def share(self) -> Path:
        """Share folder of the package: the package's folder, or a folder of links if setup.py or CMakeLists.txt install
        files elsewhere.
        """
        from rosidl_py_gen.type_loading.share_folder import share_folder

        return share_folder(self.name, self.folder, problem=_warn_of_share)


def _warn_of_share(text: str) -> None:
    warnings.warn(ImportHookWarning(text), stacklevel=3)


_lock = threading.Lock()
_installed: _Finder | None = None


def install_import_hook(
    *,
    message_api: Literal["native", "rclpy"] = "native",
    path: SearchFolders = (),
    workspace_of: str | os.PathLike[str] | None = None,
    override_installed: bool = False,
    distro: str | None = None,
) -> Registration:
    """Make ``import x_msgs.msg`` work in this process for every package with definitions.

    Definitions are searched in `path`, in the workspace of `workspace_of`, in AMENT_PREFIX_PATH, in installed wheels,
    and in the bundled interfaces. Modules are compiled in memory on their first import; modules of rclpy's API are
    cached on disk.

    Args:
        message_api: ``native`` for the classes of `get_message`; ``rclpy`` for classes that behave as in a ROS
            installation (`array.array` for sequences of numbers, bytes for `byte`, rclpy's `repr` and checks), together
            with `rclpy` itself and its companions.
        path: package folders, folders of packages, or ``src`` of workspaces.
        workspace_of: a script or folder. The workspace contains the first folder upwards with a package.xml; a folder
            outside of packages is a workspace itself. Python packages with the names of ROS packages of the workspace
            and of `path` become importable, too.
        override_installed: also replace importable packages, such as packages of a sourced ROS installation. By default
            they are used; either way, a warning is issued.
        distro: ``humble``, ``jazzy``, ``kilted`` or ``lyrical``: definitions of this distribution follow the
            definitions of `path` and of the workspace. By default the definitions of ROS_DISTRO, or of Jazzy, are last.

    Returns:
        A registration. Its `close`, or the end of a ``with`` block, removes the hook and its modules.

    Raises:
        DefinitionError: a folder of `path` contains no package or two of one name, or `workspace_of` does not exist, or
            one of the arguments is not a path.
        RuntimeError: a hook with other settings is installed; with the same settings, that hook is returned.
        UnknownDistributionError: `distro` has another value.
        ValueError: `message_api` has another value.
    """
    global _installed
    if message_api not in ("native", "rclpy"):
        raise ValueError(f'message_api: expected "native" or "rclpy", found {message_api!r:.100}')
    entries = [path] if isinstance(path, (str, os.PathLike)) else path
    if not isinstance(entries, Iterable):
        raise _wrong("path", "a folder or several", path)
    folders = tuple(_path_text("path", entry) for entry in entries)
    settings = (
        message_api,
        folders,
        None if workspace_of is None else _path_text("workspace_of", workspace_of),
        override_installed,
        Distribution.selected(distro),
    )
    with _lock:
        if _installed is None:
            _installed = _Finder(*settings)
            sys.meta_path.insert(0, _installed)
            sys.meta_path.append(_installed.fallback)
        elif _installed.settings != settings:
            raise RuntimeError("an import hook with other settings is installed; close that one first")
        finder = _installed
    return Registration(lambda: _remove(finder))


def found_packages() -> dict[str, FoundPackage]:
    """Return the packages that the installed import hook has found, by name: with definitions, or in its workspace."""
    finder = _installed
    return {} if finder is None else finder.found()


def _path_text(name: str, path: object) -> str:
    try:
        return os.fsdecode(os.fspath(path))  # type: ignore[call-overload]
    except TypeError:
        raise _wrong(name, "a path", path) from None


def _wrong(name: str, expected: str, found: object) -> DefinitionError:
    text = f"{name}: expected {expected}, found {found!r:.200}"
    return DefinitionError(Diagnostic("<install_import_hook>", 0, 0, text))


def _remove(finder: _Finder) -> None:
    global _installed
    with _lock:
        if finder is not _installed:
            return
        _installed = None
        # In place, because other code may hold the list; other finders may be gone already.
        sys.meta_path[:] = [one for one in sys.meta_path if one is not finder and one is not finder.fallback]
    for name, module in list(sys.modules.items()):
        spec = getattr(module, "__spec__", None)
        if spec is not None and (spec.loader is finder or _is_compat_package(spec)):
            del sys.modules[name]
            parent, _, child = name.rpartition(".")
            if parent in sys.modules and getattr(sys.modules[parent], child, None) is module:
                delattr(sys.modules[parent], child)


def _is_compat_package(spec: ModuleSpec) -> bool:
    return spec.origin is not None and Path(spec.origin).is_relative_to(RCLPY_COMPAT_DIR)


class _FallbackFinder:
    """Import finder at the end of `sys.meta_path`, which finds the Python packages of the hook's `path` and workspace.

    If a well-known message package is imported that no finder has, this finder raises an error that names the package's
    repository.
    """

    def __init__(self, packages: dict[str, Path], distro: str) -> None:
        self.packages = packages
        self._distro = distro

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if path is not None:
            return None
        if fullname not in self.packages:
            # `importlib.util.find_spec`, which has another caller here, returns None for a missing package.
            caller = sys._getframe(1).f_back
            is_import = caller is not None and caller.f_code.co_name == "_find_and_load_unlocked"
            return self._spec_of_later_finder(fullname) if is_import and "_" in fullname else None
        folder = self.packages[fullname]
        found = PathFinder.find_spec(fullname, [str(folder), str(folder / "src")])
        return found if found is not None and found.origin is not None else None

    def _spec_of_later_finder(self, name: str) -> ModuleSpec | None:
        note = MessagePackage(name).download_note(self._distro)
        for finder in sys.meta_path[sys.meta_path.index(self) + 1 :] if note and self in sys.meta_path else ():
            find = getattr(finder, "find_spec", None)
            if find is not None and (found := find(name, None)) is not None:
                return found  # type: ignore[no-any-return]
        if note:
            raise ModuleNotFoundError(f"No module named {name!r}. {note}", name=name)
        return None


class _Finder(Loader):
    """Import finder at the start of `sys.meta_path`, which is also the loader of the modules that the import hook
    provides.
    """

    def __init__(
        self,
        message_api: str,
        path: Sequence[str],
        workspace_of: str | None,
        override_installed: bool,
        choice: Distribution,
    ) -> None:
        from rosidl_py_gen.compiler.frontend import Workspace
        from rosidl_py_gen.type_loading.interface_modules import Interfaces
        from rosidl_py_gen.type_loading.scan_cache import search, workspace_packages

        self.settings = (message_api, tuple(path), workspace_of, override_installed, choice)
        self._is_rclpy, self._override = message_api == "rclpy", override_installed
        workspaces = [Workspace(Path(entry).resolve()) for entry in path]
        self._sources = [Path(entry).resolve() for entry in path]
        if workspace_of is not None and not os.path.exists(workspace_of):
            raise _wrong("workspace_of", "a script or a folder", workspace_of)
        workspace = None if workspace_of is None else Workspace.around(Path(workspace_of).resolve())
        if workspace is not None:
            self._sources.append(workspace.folder)
            workspaces.append(workspace)
        packages: dict[str, Path] = {}
        for one in reversed(workspaces):
            packages |= workspace_packages(one)
        self.fallback = _FallbackFinder(packages, choice.name)
        self._compat = {entry.name for entry in os.scandir(RCLPY_COMPAT_DIR)} if self._is_rclpy else set()
        folders, found = search(path, workspace, choice)
        self._interfaces: Interfaces = Interfaces(found, folders, choice.name if choice.is_explicit else None)
        self._other_origins: dict[str, str] = {}
        self._own: set[tuple[str, str]] = set()
        """Packages and their kinds of interfaces (msg, srv, action) for which it is known that no other finder provides
        them."""
        self._search_state = threading.local()

    # --- finding ------------------------------------------------------------------------------------------------------

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, _, rest = fullname.partition(".")
        if not rest and fullname in self.fallback.packages and self._is_plain_folder(fullname):
            return self.fallback.find_spec(fullname)
        if fullname in _PARSER and self._is_rclpy:
            return None if self._other_spec(fullname, path) else self._parser(fullname)
        if fullname in self._compat:
            return self._compat_package(fullname)
        if package not in self._interfaces.search.packages:
            return None
        kind, _, module = rest.partition(".")
        if not rest:
            return self._package(package)
        if kind not in RosName.KINDS or kind not in self._interfaces.kinds(package):
            return None
        if not module:
            return None if self._uses_other(package, kind, path) else ModuleSpec(fullname, self, is_package=True)
        parent = sys.modules.get(f"{package}.{kind}")
        is_ours = parent is not None and getattr(parent.__spec__, "loader", None) is self
        return ModuleSpec(fullname, self) if is_ours and module in self._interfaces.modules(package, kind) else None

    def found(self) -> dict[str, FoundPackage]:
        found = {name: FoundPackage(name, folder, ()) for name, folder in self.fallback.packages.items()}
        for name, package in self._interfaces.search.packages.items():
            folder = package.folder
            if package.known_files is not None:  # of a distribution, in several folders
                from rosidl_py_gen.type_loading.share_folder import share_folder

                folder = share_folder(name, folder, package.known_files)
            files = (f"{interface.kind}/{file.name}" for interface, file in package.files.items())
            found[name] = FoundPackage(name, folder, tuple(sorted(files)))
        return dict(sorted(found.items()))

    def _compat_package(self, name: str) -> ModuleSpec | None:
        """Return the import spec of a companion package of rclpy; None if an installed package is used instead."""
        other, own = self._other_spec(name, None), PathFinder.find_spec(name, [str(RCLPY_COMPAT_DIR)])
        if own is None or other is None or other.origin is None:
            return own
        self._warn_duplicate(name, name, other.origin, str(RCLPY_COMPAT_DIR / name))
        return own if self._override else None

    def _warn_duplicate(self, package: str, name: str, other: str, own: str) -> None:
        if package not in self._other_origins:
            self._other_origins[package] = other
            used, unused = (own, other) if self._override else (other, own)
            warnings.warn(ImportHookWarning(f"{name}: using {used}, not {unused}"), stacklevel=2)

    def _package(self, package: str) -> ModuleSpec | None:
        """Return the import spec of a message package, which is in the workspace or made by the hook.

        Returns None for a package that other finders can import.
        """
        other = self._other_spec(package, None)
        if other is not None and other.loader is not None and other.origin:
            return None
        folder = self._interfaces.search.packages[package].folder
        inside = folder / package / "__init__.py"
        if inside.is_file() and any(folder.resolve().is_relative_to(source) for source in self._sources):
            return spec_from_file_location(package, inside, submodule_search_locations=[str(inside.parent)])
        return ModuleSpec(package, self, is_package=True)

    def _uses_other(self, package: str, kind: str, path: Sequence[str] | None) -> bool:
        """Return True if the hook leaves the import of a message package to other finders, which have modules that the
        hook does not provide.
        """
        name = f"{package}.{kind}"
        if path is None:
            found = self._other_spec(package, None)
            path = found.submodule_search_locations if found is not None else None
        other = self._other_spec(name, path) if path is not None else None
        if other is None or other.loader is None or not other.origin:
            return False
        if GeneratedCode.is_generated(Path(other.origin)) and (self._override or not self._is_rclpy):
            return not self._is_rclpy  # generated: the same classes, or classes of the other API
        folder = self._interfaces.search.packages[package].folder
        self._warn_duplicate(package, name, other.origin, f"the definitions in {folder}")
        return not self._override

    def _other_spec(self, fullname: str, path: Sequence[str] | None) -> ModuleSpec | None:
        if getattr(self._search_state, "name", "") == fullname:
            return None
        self._search_state.name = fullname
        try:
            for finder in sys.meta_path:
                find = getattr(finder, "find_spec", None)
                found: ModuleSpec | None = find(fullname, path) if find is not None and finder is not self else None
                if found is not None:
                    return found
        finally:
            self._search_state.name = ""
        return None

    def _is_plain_folder(self, name: str) -> bool:
        """Return True if other finders find only a folder without ``__init__.py`` for a name.

        The folder may be a ROS package's source.
        """
        other = self._other_spec(name, None)
        is_folder = other is not None and other.origin is None and other.submodule_search_locations is not None
        return is_folder and name not in self._interfaces.search.packages

    def _parser(self, fullname: str) -> ModuleSpec | None:
        from rosidl_py_gen.cdr import rclpy_messages

        if fullname == _PARSER[0]:
            return ModuleSpec(fullname, self, is_package=True)
        return spec_from_file_location(fullname, Path(rclpy_messages.__path__[0], "slot_types.py"))

    # --- loading ------------------------------------------------------------------------------------------------------

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Define the contents of a module that the hook imports.

        Raises:
            DefinitionError: a definition has problems.
            ImportError: a type needs a package whose classes another tool provides, or two interfaces have one module.
        """
        package, _, rest = module.__name__.partition(".")
        kind, _, name = rest.partition(".")
        if not kind:
            module.__doc__ = f"The ROS interface package {package}."
        elif name:
            self._populate(module, self._interfaces.modules(package, kind)[name])
        elif package in self._interfaces.search.packages:
            self._export_lazily(module, package, kind)

    def _populate(self, module: ModuleType, names: list[RosName]) -> None:
        if len(names) > 1:
            raise ImportError(f"{' and '.join(map(str, names))} would both be the module {module.__name__}")
        code = self._interfaces.code(names[0]) if self._is_rclpy else None
        for package in sorted({part.partition("/")[0] for part in code[0]} if code else ()):
            for kind in sorted(self._interfaces.kinds(package)):
                if (package, kind) in self._own:
                    continue
                if self._uses_other(package, kind, None):
                    origin = self._other_origins[package]
                    text = f"{names[0]} needs {package}, and {origin} has others; override_installed=True hides them"
                    raise ImportError(text, name=module.__name__)
                self._own.add((package, kind))
        self._interfaces.fill(module, names[0], code[1] if code else None)

    def _export_lazily(self, module: ModuleType, package: str, kind: str) -> None:
        from rosidl_py_gen.cdr.lazy import lazy_exports

        classes = self._interfaces.classes(package, kind)
        module.__dict__["__getattr__"], module.__dict__["__dir__"] = lazy_exports(module.__name__, classes)
        module.__dict__["__all__"] = sorted(classes)
