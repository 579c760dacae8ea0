"""Classes at run time: by name from what is importable or on the search path, and from the text bags carry.

There is one class per type in a process. A class already loaded for the same RIHS01 hash is used again; packages are
imported only when this tool generated them, because importing runs code and names come from files and networks.
"""

from __future__ import annotations

import os
import re
import sys
import threading
from itertools import pairwise
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from rosidl_py_gen.base.installed_classes import PREGENERATED_PACKAGE, find_installed_class
from rosidl_py_gen.base.names import RosName, split_ros_name
from rosidl_py_gen.cdr.message import Action, Message, Service
from rosidl_py_gen.cdr.typesupport import constants, hashes_of, referenced_classes, type_description, type_hash
from rosidl_py_gen.errors import DefinitionError, Diagnostic, InvalidNameError, TypeNotFoundError, display_path

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry

T = TypeVar("T")
SearchFolders: TypeAlias = "Sequence[str | os.PathLike[str]] | str | os.PathLike[str]"
HashPredicate: TypeAlias = "Callable[[Mapping[str, str]], bool]"
ClassFinder: TypeAlias = "Callable[[InterfaceRegistry, RosName], type | None]"
"""Gives a class that is there already for a checked type."""

_MEMORY = "rosidl_py_gen_memory"  # top of the module names of classes compiled in memory
_MAX_LEAVES = 10_000  # of one definition, for which code is generated; each takes up to 4 kB
_lock = threading.RLock()
_loaded: dict[str, list[type]] = {}  # full name -> classes in use for it, one for each different definition
_by_name: dict[tuple[str, tuple[str, ...]], type] = {}
_registries: dict[tuple[str, ...], InterfaceRegistry] = {}
_worlds = 0


def get_message(name: str, *, path: SearchFolders = ()) -> type[Message]:
    """The class of ``std_msgs/msg/String`` (or short ``std_msgs/String``).

    The generated class if it is importable, else one made of the definition in `path`, AMENT_PREFIX_PATH or the bundled
    interfaces. Messages of services and actions have names too: ``std_srvs/srv/SetBool_Request``. The answer is kept:
    definitions edited, and packages that become importable later, are not noticed.

    Raises:
        InvalidNameError: the name has another shape.
        TypeNotFoundError: there is no such message.
        DefinitionError: its definition has problems.
    """
    return _get(name, "msg", Message, path)


def get_service(name: str, *, path: SearchFolders = ()) -> type[Service[Any, Any]]:
    """The class of ``std_srvs/srv/SetBool``; errors as `get_message`."""
    return _get(name, "srv", Service, path)


def get_action(name: str, *, path: SearchFolders = ()) -> type[Action[Any, Any, Any]]:
    """The class of ``example_interfaces/action/Fibonacci``; errors as `get_message`."""
    return _get(name, "action", Action, path)


def compile_definition(name: str, text: str) -> type[Any]:
    """A class from the definition text that bags and MCAP files carry.

    Args:
        name: full name of the first definition; its kind (msg, srv, action) says how the text is read.
        text: ros2msg text: the definition, then for each type it uses a line of ``=`` characters, a line
            ``MSG: package/Name`` and its definition; or the same with ``IDL: package/msg/Name``, and rosbag2's
            ``SRV: package/srv/Name`` above a service. Types the text lacks are taken from the search path.

    Returns:
        A message, service or action class; one that is loaded already if it says the same.

    Raises:
        InvalidNameError: a name has another shape.
        DefinitionError: the text has problems, located as ``<name>:line:column``.
    """
    with _lock:
        return _class(registry_of_text(name, text), split_ros_name(name, "msg"), _same_definition_and_defaults)


def registry_of_text(name: str, text: str) -> InterfaceRegistry:
    """The definitions of such a text, read and checked; arguments and errors as of `compile_definition`."""
    from rosidl_py_gen.compiler.frontend.model import SourceText
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check, raise_diagnostics
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

    if not isinstance(text, str):
        raise TypeError(f"expected the text of a definition, found {type(text).__name__}")
    top, names = split_ros_name(name, "msg"), {}
    with _lock:
        defaults = _registry(()).search
    registry = InterfaceRegistry(SearchPath(defaults.packages, [], ["the text", *defaults.searched]))
    for part, body, is_idl in _parts(top, text):
        name_in_file, kind = _read_as(part, body, is_idl)
        names[name_in_file] = registry.add_text(name_in_file, SourceText(f"<{part}>", body, kind))
    check(registry, names)
    raise_diagnostics(registry)
    if registry.owner(top) is None or not registry.knows(str(top)):
        raise DefinitionError(Diagnostic(f"<{top}>", 0, 0, f"the text does not define {top}"))
    return registry


def _read_as(name: RosName, text: str, is_idl: bool) -> tuple[RosName, str]:
    """Which interface a text defines, and its format.

    Topics of derived types (``X_Event``, ``A_FeedbackMessage``) carry either the text of the service or action, or that
    of the derived message alone; the number of separators tells.
    """
    from rosidl_py_gen.compiler.frontend.interface_parser import separators

    if is_idl:
        return name, "idl"
    if separators(text) != {"msg": 0, "srv": 1, "action": 2}[name.kind]:
        plain = separators(text) == 0 and "_" in name.name
        return name, "msg" if plain else name.kind
    if name.kind == "msg" or "_" not in name.name:
        return name, name.kind
    return name._replace(name=name.name.split("_")[0]), name.kind


_SEPARATOR = re.compile(r"^=+[ \t]*$")
_PART_NAME = re.compile(r"^(MSG|IDL|SRV):\s*(\S+)\s*$")


def _parts(top: RosName, text: str) -> list[tuple[RosName, str, bool]]:
    """The definitions in a concatenated text; locations count from the first line of each."""
    lines = text.splitlines()
    cuts = [
        index
        for index, line in enumerate(lines[:-1])
        if len(line) >= 8 and _SEPARATOR.match(line) and _PART_NAME.match(lines[index + 1])
    ]
    bounds = [*cuts, len(lines)]
    first = lines[: bounds[0]]
    is_idl = any(re.match(r"\s*(module\s+\w+\s*\{|#include\b)", line) for line in first)
    if cuts and cuts[0] == 0:
        first = []
    parts = [(top, "\n".join(first), is_idl)] if first or not cuts else []
    for start, end in pairwise(bounds):
        found = _PART_NAME.match(lines[start + 1])
        assert found is not None
        try:
            part = split_ros_name(found[2], "msg")
        except InvalidNameError as error:
            problem = Diagnostic(f"<{top}>", start + 2, 1, str(error), lines[start + 1])
            raise DefinitionError(problem) from error
        parts.append((part, "\n".join(lines[start + 2 : end]), found[1] == "IDL"))
    return parts


# --- by hash ----------------------------------------------------------------------------------------------------------


def find_class(name: str, fits: HashPredicate, *, path: SearchFolders = ()) -> type[Any] | None:
    """A class of this name that this process has, or can make of what is on the search path.

    Args:
        name: full name.
        fits: is told the RIHS01 hashes of the type and of all it refers to, by name; says whether it is the right one.
        path: looked through first, as by `get_message`.

    Raises:
        DefinitionError: `path` cannot be read. InvalidNameError: not a name.
    """
    split_ros_name(name)
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
    return None


def definition_origin(cls: type[Any], *, path: SearchFolders = ()) -> str:
    """Where a class that was looked for in `path` comes from: the module or file of its definition, or ``bundled``."""
    module = cls.__module__
    if not module.startswith(_MEMORY):
        return "bundled" if module.startswith(PREGENERATED_PACKAGE) else f"module {module}"
    name = split_ros_name(cls._TYPE.name)
    folders = [path] if isinstance(path, (str, os.PathLike)) else path
    with _lock:
        registry = _registry(tuple(str(entry) for entry in folders))
        package = registry.search.packages.get(name.package)
        if package is None or package.origin == "bundled":
            return "bundled" if package else "another text of this process"
        file = package.files.get(registry.owner(name) or name)
    return display_path(file or package.folder)


def class_of_registry(registry: InterfaceRegistry, name: RosName, *, path: SearchFolders = ()) -> type[Any]:
    """The class of a checked type: for it, and for each type it refers to, one of that hash, compiled if there is none.

    `path` as for `find_class`.
    """

    def find(registry: InterfaceRegistry, part: RosName) -> type | None:
        text, wanted = str(part), registry.type_hash(str(part))
        return find_class(text, lambda hashes: hashes[text] == wanted, path=path)

    with _lock:
        return _class(registry, name, find)


# --- by name ----------------------------------------------------------------------------------------------------------


def _get(text: str, kind: str, base: type[T], path: SearchFolders) -> type[T]:
    if not isinstance(text, str):
        raise InvalidNameError(f"expected the name of an interface, found {type(text).__name__}")
    entries = tuple(str(entry) for entry in ([path] if isinstance(path, (str, os.PathLike)) else path))
    name = split_ros_name(text, kind)
    full_name = str(name)
    with _lock:
        cls: type | None = _by_name.get((full_name, entries))
        if cls is None:
            cls = None if entries else find_installed_class(name)
            cls = cls or _pregenerated_class(name, entries) or _from_definitions(name, entries)
            _by_name[full_name, entries] = cls
    if not issubclass(cls, base):
        kinds = {Message: "a message", Service: "a service", Action: "an action"}
        found = next(words for one, words in kinds.items() if issubclass(cls, one))
        raise TypeNotFoundError(f"{full_name} is {found}, not {kinds[base]}")
    return cls


def _pregenerated_class(name: RosName, path: tuple[str, ...]) -> type | None:
    """The class that a wheel holds for a bundled definition: 10 ms, where compiling the first one takes 80.

    None where another definition comes before the bundled one, or another class stands for a part of it.
    """
    if path or os.environ.get("AMENT_PREFIX_PATH"):
        return None
    cls = find_installed_class(name, PREGENERATED_PACKAGE)
    parts = referenced_classes(cls) if cls is not None else {}
    for full_name, part in parts.items():
        in_use = _loaded.get(full_name) or [find_installed_class(split_ros_name(full_name)) or part]
        if part not in in_use:
            return None
    for full_name, part in parts.items():
        in_use = _loaded.setdefault(full_name, [])
        if part not in in_use:
            in_use.append(part)
    return cls


def _registry(path: tuple[str, ...]) -> InterfaceRegistry:
    """The parsed interfaces of a search path, kept; a file that changes afterwards is not read again."""
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

    key = (*path, os.environ.get("AMENT_PREFIX_PATH", ""))
    if key not in _registries:
        _registries[key] = InterfaceRegistry(scan_search_path(path))
    return _registries[key]


def registry_of(name: RosName) -> InterfaceRegistry | None:
    """The interfaces of the search path, with this one read and checked; None when it is not there or has problems."""
    from rosidl_py_gen.compiler.frontend.definition_text import read_checked

    with _lock:
        registry = _registry(())
        try:
            read_checked(registry, name)
        except TypeNotFoundError:
            return None
        except DefinitionError:
            _registries.clear()
            return None
        return registry


def _from_definitions(name: RosName, path: tuple[str, ...]) -> type:
    from rosidl_py_gen.compiler.frontend.definition_text import read_checked

    registry = _registry(path)
    if path and registry.owner(name) is None and (cls := find_installed_class(name)) is not None:
        return cls
    try:
        read_checked(registry, name)
    except DefinitionError:  # what was read half must not be used: the next call reads it again
        _registries.clear()
        raise
    return _class(registry, name, _same_definition_and_defaults)


# --- compile in memory ------------------------------------------------------------------------------------------------


def load_compiler() -> None:
    """Import what making a class of a definition needs, which else the first of them waits for. In any thread."""
    from rosidl_py_gen.compiler.codegen import module_sources, render  # noqa: F401
    from rosidl_py_gen.compiler.frontend import (
        definition_text,  # noqa: F401
        search_path,
    )

    search_path.preload()
    render.preload()


def _class(registry: InterfaceRegistry, name: RosName, find: ClassFinder) -> type:
    """The class of a checked type: in use already, importable, or compiled now."""
    cls = find(registry, name)
    if cls is not None:  # the compiler need not be loaded
        return cls
    from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner

    layouts, known = LayoutPlanner(registry.message, max_leaves=_MAX_LEAVES), dict[str, type]()

    def made(part: RosName) -> type:
        """Each type once: comparing or planning one costs as much as all it refers to."""
        cls = known.get(str(part))
        if cls is None:
            cls = known[str(part)] = find(registry, part) or _compile(registry, part, layouts, made)
        return cls

    return made(name)


def _same_definition_and_defaults(registry: InterfaceRegistry, name: RosName) -> type | None:
    """A class in use, or importable, with the same defaults and constants, too."""
    in_use = _loaded.setdefault(str(name), [])
    found = next((cls for cls in in_use if _same_definition(registry, str(name), cls)), None)
    if found is None:
        found = find_installed_class(name)
        if found is None or not _same_definition(registry, str(name), found):
            return None
        in_use.append(found)
    return found


def _same_definition(registry: InterfaceRegistry, full_name: str, cls: type) -> bool:
    """Whether a class has the same fields, default values and constants, down to the last nested type."""
    if type_hash(cls) != registry.type_hash(full_name):
        return False
    description, constants_of = registry.fingerprint(full_name)
    own = {
        name: {key: repr(value) for key, value in constants(nested).items()}
        for name, nested in referenced_classes(cls).items()
    }
    return type_description(cls) == description and own == constants_of


def _compile(
    registry: InterfaceRegistry, name: RosName, layouts: LayoutPlanner, made: Callable[[RosName], type]
) -> type:
    from rosidl_py_gen.compiler.codegen.module_sources import module_source
    from rosidl_py_gen.compiler.codegen.template_model import Target, module_path
    from rosidl_py_gen.compiler.frontend.model import messages_of

    global _worlds
    _worlds += 1
    root = f"{_MEMORY}.w{_worlds}."
    modules: dict[str, str] = {}

    def known(full_name: str) -> str | None:
        """Compile what the type needs first, or find it."""
        if full_name not in modules:
            cls = made(needed) if (needed := split_ros_name(full_name)) != top else None
            modules[full_name] = cls.__module__ if cls else root + module_path(full_name)
        return modules[full_name]

    top = registry.owner(name)
    interface = registry.interface(top) if top else None
    assert top is not None and interface is not None
    own = {str(top), *(str(message.name) for message in messages_of(interface))}
    target = Target(root, lambda full_name: None if full_name in own else known(full_name), registry.type_hash, False)
    source = module_source(registry, top, layouts, target)
    module = _run(root + module_path(str(top)), source)
    for exported in module.__all__:
        cls = getattr(module, exported)
        _loaded.setdefault(cls._TYPE.name, []).append(cls)
    return next(cls for cls in _loaded[str(name)] if cls.__module__ == module.__name__)


def _run(module_name: str, source: str) -> ModuleType:
    """Execute generated source as a module that pickle and typing can find again."""
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
