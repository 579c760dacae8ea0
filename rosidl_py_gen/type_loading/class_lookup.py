"""Lookup of message, service and action classes by name or by definition text, compiled if necessary.

There is one class per type in a process: a loaded class of the same RIHS01 hash is used again. Only packages that this
tool generated are imported, because an import runs code, and names may be from files and networks.

Thread: any. `_lock` is held while classes are searched, compiled and registered, so all threads get the same class, and
none gets an incomplete one. A thread that imports a module of the import hook takes `_lock` inside the import. So
importable classes are imported before `_lock` is taken (`_import_classes`): an import under the lock could wait for the
other thread, which waits for the lock.
"""

from __future__ import annotations

import os
import sys
import threading
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.base.resources import GeneratedCode, InstalledInterfaces
from rosidl_py_gen.cdr import Action, Message, Service
from rosidl_py_gen.cdr.type_queries import constants, hashes_of, referenced_classes, type_description, type_hash
from rosidl_py_gen.errors import DefinitionError, InvalidNameError, TypeNotFoundError, display_path

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from importlib.machinery import ModuleSpec

    from rosidl_py_gen.compiler.codegen import ModuleSources
    from rosidl_py_gen.compiler.frontend import InterfaceRegistry

T = TypeVar("T")
SearchFolders: TypeAlias = "Sequence[str | os.PathLike[str]] | str | os.PathLike[str]"
HashPredicate: TypeAlias = "Callable[[Mapping[str, str]], bool]"
ClassFinder: TypeAlias = "Callable[[InterfaceRegistry, RosName], type | None]"
"""Function that returns the existing class of a type whose definition was checked; None if there is none."""

_MEMORY = "rosidl_py_gen_memory"
"""Name of the package in `sys.modules` that contains the modules of classes that were compiled in memory."""
_lock = threading.RLock()
"""Lock of all caches of loaded classes and registries in this module."""
_loaded: dict[str, list[type]] = {}
"""Loaded classes by full type name; a name has a class for each different definition."""
_by_name: dict[tuple[str, tuple[str, ...], Distribution], type] = {}
_registries: dict[tuple[tuple[str, ...], str, Distribution], InterfaceRegistry] = {}
_compilations = 0


def get_message(name: str, *, path: SearchFolders = (), distro: str | None = None) -> type[Message]:
    """Return the class of a message, such as ``std_msgs/msg/String`` or short ``std_msgs/String``.

    This is the generated class if it is importable, else a class of the definition in `path`, AMENT_PREFIX_PATH or the
    bundled interfaces of the distribution that ROS_DISTRO names. Messages of services and actions have names such as
    ``std_srvs/srv/SetBool_Request``. The result is cached: later changes of definitions and of importable packages have
    no effect.

    Args:
        name: name of the message.
        path: package folders, folders of packages, or ``src`` of workspaces.
        distro: ``humble``, ``jazzy``, ``kilted`` or ``lyrical``: the class of the definition in `path`, else of this
            distribution, also if another class is importable.

    Raises:
        InvalidNameError: the name is invalid.
        TypeNotFoundError: there is no such message.
        DefinitionError: its definition has problems.
        UnknownDistributionError: `distro` has another value.
    """
    return _get(name, "msg", Message, path, distro)


def get_service(name: str, *, path: SearchFolders = (), distro: str | None = None) -> type[Service[Any, Any]]:
    """Return the class of a service, such as ``std_srvs/srv/SetBool``; arguments and errors as for `get_message`."""
    return _get(name, "srv", Service, path, distro)


def get_action(name: str, *, path: SearchFolders = (), distro: str | None = None) -> type[Action[Any, Any, Any]]:
    """Return the class of an action, such as ``example_interfaces/action/Fibonacci``.

    Arguments and errors are as for `get_message`.
    """
    return _get(name, "action", Action, path, distro)


def compile_definition(name: str, text: str) -> type[Any]:
    """Return the class that a definition text of a bag or MCAP file defines.

    Args:
        name: full name of the first definition; its kind (msg, srv, action) selects the parser.
        text: ros2msg text: the definition, then for each type it uses a line of ``=`` characters, a line
            ``MSG: package/Name`` and its definition; or the same with ``IDL: package/msg/Name``, and rosbag2's
            ``SRV: package/srv/Name`` above a service. Missing types are taken from the search path.

    Returns:
        A message, service or action class; a loaded class if it has the same definition.

    Raises:
        InvalidNameError: a name is invalid.
        DefinitionError: the text has problems, located as ``<name>:line:column``.
    """
    top = RosName.parse(name, "msg")
    if not isinstance(text, str):
        raise TypeError(f"expected the text of a definition, found {type(text).__name__}")
    from rosidl_py_gen.compiler.frontend import registry_from_text

    with _lock:
        registry = registry_from_text(top, text, _registry(()).search)
    _import_classes(registry, top)
    with _lock:
        return _class(registry, top, _same_definition_and_defaults)


# --- by hash or full name ---------------------------------------------------------------------------------------------


class ClassSearch:
    """Search for interface classes by full name, in folders before the search path.

    Args:
        path: folders that are searched first, as by `get_message`.
        distro: distribution whose definitions `get` and `origin` use, as `get_message` does.
    """

    def __init__(self, path: SearchFolders = (), distro: str | None = None) -> None:
        self._path, self._distro = path, distro

    def get(self, name: str) -> type[Any]:
        """Return the message, service or action class of a full name; errors are as for `get_message`."""
        return _get(name, "", object, self._path, self._distro)

    def find(self, name: str, fits: HashPredicate) -> type[Any] | None:
        """Return a class of a type whose RIHS01 hashes fit: a loaded class, or a class of the search path or of any
        distribution.

        Returns None if no class fits.

        Args:
            name: full name of the type.
            fits: returns True if the hashes of the requested type and of all types that it refers to, by name, fit.

        Raises:
            DefinitionError: a definition in the folders cannot be read.
        """
        path = self._path
        _import_class(RosName.parse(name))
        with _lock:
            for cls in _loaded.get(name, ()):
                if fits(hashes_of(cls)):
                    return cls
            for folders in (path, ()) if path else ((),):
                try:
                    cls = _get(name, "", object, folders)
                except TypeNotFoundError:
                    continue
                except DefinitionError:
                    if folders:
                        raise
                    continue
                if fits(hashes_of(cls)):
                    return cls
            for definition in distribution_definitions(name):
                cls = definition.load()
                if fits(hashes_of(cls)):
                    return cls
        return None

    def origin(self, cls: type[Any]) -> str:
        """Return the origin of a class's definition for display: a module, the file of the definition, or ``bundled``.

        A bundled definition that only another distribution than the default has gives ``bundled (humble)``.
        """
        module = cls.__module__
        if not module.startswith(_MEMORY):
            return "bundled" if module.startswith(GeneratedCode.BUNDLED_PREFIX) else f"module {module}"
        name = RosName.parse(cls._TYPE.name)
        with _lock:
            registry = _registry(_entries(self._path), self._distro)
            package = registry.search.packages.get(name.package)
            if package is None or package.is_bundled:
                for one in distribution_definitions(str(name)):
                    if one.type_hash == type_hash(cls) and Distribution.DEFAULT not in one.distributions:
                        return f"bundled ({', '.join(one.distributions)})"
                return "bundled" if package else "another text of this process"
            file = package.files.get(registry.owner(name) or name)
        return display_path(file or package.folder)


class DistributionDefinition(NamedTuple):
    """Definition of a type that differs between distributions, with the distributions that have it, oldest first."""

    type_name: str
    type_hash: str
    distributions: tuple[str, ...]

    def load(self) -> type[Any]:
        """Return the class of the distribution's definition, which is compiled at the first call. Thread: any."""
        return _get(self.type_name, "", object, (), self.distributions[-1])


def distribution_definitions(name: str) -> tuple[DistributionDefinition, ...]:
    """Return the different definitions that the bundled distributions have of a type, which may be derived from a
    service or action.

    The lookup is in a generated table; nothing is compiled. Constants and default values are not compared. The result
    is empty for a type that is the same in all distributions, or in none.
    """
    from rosidl_py_gen.msgs.distribution_hashes import HASHES

    rows = HASHES.get(name, {})
    return tuple(DistributionDefinition(name, text, tuple(distros.split())) for text, distros in rows.items())


def class_of_registry(registry: InterfaceRegistry, name: RosName, *, path: SearchFolders = ()) -> type[Any]:
    """Return the class of a checked type.

    For the type and all types in it, loaded or importable classes with the same hash are used.
    """

    def find(registry: InterfaceRegistry, part: RosName) -> type | None:
        text, wanted = str(part), registry.type_hash(str(part))
        return ClassSearch(path).find(text, lambda hashes: hashes[text] == wanted)

    _import_classes(registry, name)
    with _lock:
        return _class(registry, name, find)


# --- by name ----------------------------------------------------------------------------------------------------------


def _entries(path: SearchFolders) -> tuple[str, ...]:
    return tuple(str(entry) for entry in ([path] if isinstance(path, (str, os.PathLike)) else path))


def _get(text: str, kind: str, base: type[T], path: SearchFolders, distro: str | None = None) -> type[T]:
    if not isinstance(text, str):
        raise InvalidNameError(f"expected the name of an interface, found {type(text).__name__}")
    entries = _entries(path)
    name = RosName.parse(text, kind)
    full_name = str(name)
    choice = Distribution.selected(distro)
    if (full_name, entries, choice) not in _by_name:
        _import_class(name)
    with _lock:
        cls: type | None = _by_name.get((full_name, entries, choice))
        if cls is None:
            cls = _installed_class(name, entries, choice)
            cls = cls or _pregenerated_class(name, entries, choice) or _from_definitions(name, entries, choice)
            _by_name[full_name, entries, choice] = cls
    if not issubclass(cls, base):
        kinds = {Message: "a message", Service: "a service", Action: "an action"}
        found = next(words for one, words in kinds.items() if issubclass(cls, one))
        raise TypeNotFoundError(f"{full_name} is {found}, not {kinds[base]}")
    return cls


def find_installed_class(name: RosName, *roots: str) -> type | None:
    """Return the importable generated class of an interface; None if there is none.

    Only generated packages are imported: an import runs code, and names may be from files and networks.

    Args:
        name: name of the interface.
        roots: import prefixes in order; by default packages of the user, then `rosidl_py_gen.msgs`.
    """
    for root in roots or ("", GeneratedCode.RUNTIME_PREFIX):
        # The import hook can add modules to a package; only generated files count here.
        if not (
            _is_generated_package(root + name.package) and _is_generated_package(f"{root}{name.package}.{name.kind}")
        ):
            continue
        try:
            package = import_module(f"{root}{name.package}.{name.kind}")
            cls = getattr(package, py_name(name.name), None)
        except ImportError:
            continue
        if isinstance(cls, type) and getattr(getattr(cls, "_TYPE", None), "name", "") == str(name):
            return cls
    return None


def _is_generated_package(package: str) -> bool:
    loaded = sys.modules.get(package)
    try:
        spec: ModuleSpec | None = loaded.__spec__ if loaded is not None else find_spec(package)
    except (ImportError, ValueError, AttributeError):
        return False
    origin = spec.origin if spec is not None else None
    if origin is None or not origin.endswith("__init__.py"):
        return False
    return GeneratedCode.is_generated(Path(origin))


def _import_class(name: RosName) -> None:
    """Import the generated class of a type from the user's packages, if any. Lock: _lock should not be held."""
    find_installed_class(name, "")


def _import_classes(registry: InterfaceRegistry, name: RosName) -> None:
    """Import the modules of a checked type and of all types that it refers to. Lock: _lock should not be held."""
    for used in registry.closure(str(name)):
        _import_class(RosName.parse(used))


def _installed_class(name: RosName, path: tuple[str, ...], choice: Distribution) -> type | None:
    """Return the importable generated class of a type.

    Returns None if there is no such class, or if `path` or a distribution was requested. A class in
    `rosidl_py_gen.msgs` is returned only if it has the distribution's definition.
    """
    if path or choice.is_explicit:
        return None
    cls = find_installed_class(name)
    is_own = cls is not None and cls.__module__.startswith(GeneratedCode.RUNTIME_PREFIX)
    return cls if cls is None or not is_own or _has_definition_of(cls, choice.name) else None


def _has_definition_of(cls: type[Any], distro: str) -> bool:
    """Return True if the definition of a class of the default distribution is the same in the distribution `distro`."""
    if distro == Distribution.DEFAULT:
        return True
    from rosidl_py_gen.compiler.frontend import BundledInterfaces

    used = map(RosName.parse, (cls._TYPE.name, *referenced_classes(cls)))
    changed = BundledInterfaces.of(distro).changed
    return all(one._replace(name=one.name.partition("_")[0]) not in changed for one in used)


def _pregenerated_class(name: RosName, path: tuple[str, ...], choice: Distribution) -> type | None:
    """Return the class of a bundled type that was generated when the wheel of this package was built.

    Loading it takes 10 ms, a compilation 80 ms. Returns None if another definition precedes the bundled one, if the
    distribution has another definition, or if a type that it refers to has another class.
    """
    if path:
        return None
    if not choice.is_explicit and (
        os.environ.get("AMENT_PREFIX_PATH") or os.path.isdir(InstalledInterfaces.ros_index())
    ):
        return None
    cls = find_installed_class(name, GeneratedCode.BUNDLED_PREFIX)
    if cls is not None and not _has_definition_of(cls, choice.name):
        return None
    parts = referenced_classes(cls) if cls is not None else {}
    for full_name, part in parts.items():
        in_use = _loaded.get(full_name) or [find_installed_class(RosName.parse(full_name)) or part]
        if part not in in_use:
            return None
    for full_name, part in parts.items():
        in_use = _loaded.setdefault(full_name, [])
        if part not in in_use:
            in_use.append(part)
    return cls


def _registry(path: tuple[str, ...], distro: str | None = None) -> InterfaceRegistry:
    """Return the registry of the interfaces in folders.

    The registry is cached, so later changes of the files have no effect.
    """
    from rosidl_py_gen.compiler.frontend import InterfaceRegistry, SearchPath

    key = (path, os.environ.get("AMENT_PREFIX_PATH", ""), Distribution.selected(distro))
    if key not in _registries:
        _registries[key] = InterfaceRegistry(SearchPath.scan(path, distro=distro))
    return _registries[key]


def registry_of(name: RosName) -> InterfaceRegistry | None:
    """Return the registry of the default search path in which the interface and all types in it are checked.

    Returns None if the interface does not exist or its definition has errors.
    """
    with _lock:
        registry = _registry(())
        try:
            registry.read_checked(name)
        except TypeNotFoundError:
            return None
        except DefinitionError:
            _registries.clear()
            return None
        return registry


def _from_definitions(name: RosName, path: tuple[str, ...], choice: Distribution) -> type:
    registry = _registry(path, choice.name if choice.is_explicit else None)
    if choice.is_explicit:
        may_be_installed = name.package not in registry.search.packages
    else:
        may_be_installed = bool(path) and registry.owner(name) is None
    if may_be_installed and (cls := find_installed_class(name)) is not None:
        return cls
    try:
        registry.read_checked(name)
    except DefinitionError:  # discard incomplete interfaces, so that the next call reads them again
        _registries.clear()
        raise
    return _class(registry, name, _same_definition_and_defaults)


# --- compile in memory ------------------------------------------------------------------------------------------------


def load_compiler() -> None:
    """Import the compiler and numpy, to save time when the first class is compiled. Thread: any."""
    from importlib import metadata  # noqa: F401

    import numpy  # noqa: F401

    from rosidl_py_gen.compiler.codegen import ModuleSources
    from rosidl_py_gen.compiler.frontend import InterfaceRegistry, SearchPath  # noqa: F401

    ModuleSources.preload()


def _class(registry: InterfaceRegistry, name: RosName, find: ClassFinder) -> type:
    cls = find(registry, name)
    if cls is not None:  # the compiler is not needed
        return cls
    from rosidl_py_gen.compiler.codegen import ModuleSources

    sources = ModuleSources(registry)

    @cache  # comparing or planning a type costs as much as for all types that it refers to
    def get_class(part: RosName) -> type:
        return find(registry, part) or _compile(registry, part, sources, get_class)

    return get_class(name)


def _same_definition_and_defaults(registry: InterfaceRegistry, name: RosName) -> type | None:
    """Return a loaded or importable class that has the same definition, defaults and constants as a checked type.

    Returns None without such a class.
    """
    in_use = _loaded.setdefault(str(name), [])
    found = next((cls for cls in in_use if _same_definition(registry, str(name), cls)), None)
    if found is None:
        found = find_installed_class(name)
        if found is None or not _same_definition(registry, str(name), found):
            return None
        in_use.append(found)
    return found


def _same_definition(registry: InterfaceRegistry, full_name: str, cls: type) -> bool:
    if type_hash(cls) != registry.type_hash(full_name):
        return False
    description, constants_of = registry.description_and_constants(full_name)
    own = {
        name: {key: repr(value) for key, value in constants(nested).items()}
        for name, nested in referenced_classes(cls).items()
    }
    return type_description(cls) == description and own == constants_of


def _compile(
    registry: InterfaceRegistry, name: RosName, sources: ModuleSources, get_class: Callable[[RosName], type]
) -> type:
    global _compilations
    _compilations += 1
    top = registry.owner(name)
    assert top is not None

    def known(full_name: str) -> str:
        """Return the module with the class of another type, which is compiled if necessary."""
        return get_class(RosName.parse(full_name)).__module__

    module = _run(*sources.module(top, f"{_MEMORY}.w{_compilations}.", known))
    for exported in module.__all__:
        cls = getattr(module, exported)
        _loaded.setdefault(cls._TYPE.name, []).append(cls)
    return next(cls for cls in _loaded[str(name)] if cls.__module__ == module.__name__)


def _run(module_name: str, source: str) -> ModuleType:
    """Execute the generated source in a new module and return the module, which is in `sys.modules` for pickle and
    typing.
    """
    for end in [index for index, char in enumerate(module_name) if char == "."]:
        parent = module_name[:end]
        if parent not in sys.modules:
            package = ModuleType(parent, "Interface classes compiled in memory.")
            package.__path__ = []
            sys.modules[parent] = package
    module = ModuleType(module_name)
    sys.modules[module_name] = module
    exec(compile(source, f"<{module_name}>", "exec"), module.__dict__)
    return module
