"""Initial values of parameters from command lines, files and constructors, and warnings about unused ones.

ROS silently ignores a mistyped name in ``-p``, in a file or in `parameter_overrides`. This package logs a warning when
a peer requests the list of parameters of a node, as ``param list`` does, and at the latest when the last node closes
that the value is for. A value for several nodes is unused only if all of them ignore it, and lifecycle nodes may
declare parameters until they are configured. Each value is reported once.

The reader of YAML is in `files.py`, because importing PyYAML takes time and is not needed without parameters.
Source: docs/internals/protocol.md 10.5.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs import get_root_logger

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.parameters.store import ParameterStore
    from rosidl_py_gen.runtime.parameters.values import ParameterValue


class ParameterFileError(RosidlError, ValueError):
    """Raised for an invalid parameter file, or an invalid value of ``-p``; the text contains the position."""


@dataclass(frozen=True, slots=True)
class ParameterOverrides:
    """Initial parameter values for the nodes whose fully qualified names match `pattern`, which begins with ``/``."""

    pattern: str
    values: Mapping[str, ParameterValue]
    source: str = ""
    """Name of the file, or text of the argument, that sets the values, for warnings."""

    def matches(self, fully_qualified_name: str) -> bool:
        """Return True if the pattern matches a node: ``/*`` stands for one part of its name, ``/**`` for any number."""
        if "*" not in self.pattern:
            return self.pattern == fully_qualified_name
        tokens = fully_qualified_name.split("/")[1:]
        ends = {0}
        """Numbers of name parts that the beginning of the pattern can match. A regular expression could take
        exponential time."""
        for part in self.pattern.split("/")[1:]:
            if part == "**":
                ends = set(range(min(ends), len(tokens) + 1))
            else:
                ends = {end + 1 for end in ends if end < len(tokens) and part in ("*", tokens[end])}
            if not ends:
                return False
        return len(tokens) in ends


def overrides_for(entries: Iterable[ParameterOverrides], fully_qualified_name: str) -> dict[str, ParameterValue]:
    """Return the initial parameter values for one node by name; later entries override earlier ones."""
    matching = (entry.values for entry in entries if entry.matches(fully_qualified_name))
    return {name: value for values in matching for name, value in values.items()}


@dataclass(slots=True, eq=False)
class _OpenNode:
    """Open node of which is recorded which initial values it uses.

    The node's scope closes this object together with the node.
    """

    scope: EntityScope
    store: ParameterStore
    may_declare_more: Callable[[], bool]
    on_close: Callable[[_OpenNode], None]

    def close(self) -> None:
        self.on_close(self)


@dataclass(slots=True, eq=False)
class _OverrideSource:
    """Initial parameter values of one origin: one `-p`, a file for one node key, or `parameter_overrides` of one node.

    Attributes:
        parameters: the values, with their origin.
        nodes: open nodes that the values are for.
        has_matched: the values were for a node, which may be closed.
        unused: values that no node has used and no warning has reported.
    """

    parameters: ParameterOverrides
    nodes: list[_OpenNode] = field(default_factory=list)
    has_matched: bool = False
    unused: dict[str, ParameterValue] = field(init=False)

    def __post_init__(self) -> None:
        self.unused = dict(self.parameters.values)

    def discard_used(self) -> None:
        """Remove the values that nodes have used from `unused`."""
        for node in self.nodes:
            for name in node.store.used_overrides & self.unused.keys():
                del self.unused[name]

    def warn_unused(self) -> None:
        """Log a warning for each unused value, and forget it."""
        node_names = ", ".join(node.scope.node_name for node in self.nodes)
        declared = [name for node in self.nodes for name in node.store.values()]
        for name, value in self.unused.items():
            if name in declared:
                reason = "which ignores initial values for it"
            else:
                reason = f"which {'declares' if len(self.nodes) == 1 else 'declare'} no parameter of that name"
            self.nodes[0].scope.logger.warning(
                f"{self.parameters.source} sets the parameter {name} = {value.value!r:.100} of {node_names}, {reason}"
                f"{did_you_mean(name, [other for other in declared if other != name])}"
            )
        self.unused.clear()


class InitialValues:
    """Initial values that files and arguments set for the nodes of one context."""

    def __init__(self, parameters: Sequence[ParameterOverrides]) -> None:
        self._global_sources = [_OverrideSource(item) for item in parameters]
        self._sources = list(self._global_sources)
        self.node_names: list[str] = []
        """Fully qualified names of all nodes of the context so far, including closed ones."""

    def register_node(
        self,
        scope: EntityScope,
        store: ParameterStore,
        own: Mapping[str, ParameterValue],
        arguments: Sequence[ParameterOverrides],
        may_declare_more: Callable[[], bool],
        *,
        takes_global: bool,
    ) -> None:
        """Register a node before it declares parameters; initial values that it does not use are reported later.

        Args:
            scope: owner of the node's entities, which reports its closing.
            store: parameters of the node.
            own: values of the constructor's `parameter_overrides`.
            arguments: values of the constructor's `cli_args`.
            may_declare_more: returns True while it is too early for warnings.
            takes_global: the values of the context's command line are for the node, too.
        """
        own_sources = [_OverrideSource(item) for item in arguments]
        if own:
            own_sources.append(_OverrideSource(ParameterOverrides(scope.node_name, own, "parameter_overrides=")))
        self._sources += own_sources
        if not self._sources:
            return
        node = _OpenNode(scope, store, may_declare_more, self._on_node_close)
        for source in (*(self._global_sources if takes_global else ()), *own_sources):
            if source.parameters.matches(scope.node_name):
                source.nodes.append(node)
                source.has_matched = True
        self.node_names.append(scope.node_name)
        scope.register(node)

    def close(self) -> None:
        """Log a warning for files and arguments whose nodes never existed; called after all nodes are closed."""
        by_text: dict[str, list[_OverrideSource]] = {}
        for source in self._sources if self.node_names else ():
            by_text.setdefault(source.parameters.source, []).append(source)
        for text, sources in by_text.items():
            if any(source.has_matched or not source.unused for source in sources):
                continue
            patterns = ", ".join(dict.fromkeys(source.parameters.pattern for source in sources))
            get_root_logger().warning(
                f"{text} has parameters for {patterns}, but this process has no such node"
                f"{did_you_mean(patterns, self.node_names)}"
            )
            for source in sources:
                source.unused.clear()

    def on_listed(self, store: ParameterStore) -> None:
        """Log a warning for unused initial values of a node after a peer has requested the list of its parameters."""
        for source in self._sources:
            source.discard_used()
            listed = any(node.store is store for node in source.nodes)
            if listed and not any(node.may_declare_more() for node in source.nodes):
                source.warn_unused()

    def _on_node_close(self, closed: _OpenNode) -> None:
        for source in self._sources:
            source.discard_used()
            if source.nodes and closed.store.was_refused:
                source.unused.clear()
            if closed in source.nodes:
                if len(source.nodes) == 1:
                    source.warn_unused()
                source.nodes.remove(closed)
