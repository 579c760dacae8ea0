"""Initial values of parameters from command lines, files and constructors, and warnings about unused ones.

ROS silently ignores a mistyped name in ``-p``, in a file or in `parameter_overrides`. The warning comes when a peer
requests the list of parameters of a node, as ``param list`` does, and at the latest when the last node closes that the
value matches. A value for several nodes is unused only if all of them ignore it, and lifecycle nodes may declare
parameters until they are configured. Each value is reported once.

Reading YAML is in `files.py`, because importing PyYAML takes time and is not needed without parameters.
Source: docs/internals/protocol.md 10.5.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs.loggers import get_root_logger

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.parameters.store import ParameterStore
    from rosidl_py_gen.runtime.parameters.values import ParameterValue


class ParameterFileError(RosidlError, ValueError):
    """Raised for an invalid parameter file or value, with its position."""


@dataclass(frozen=True, slots=True)
class ParameterOverrides:
    """Values for the nodes whose fully qualified names match `pattern`, which begins with ``/``."""

    pattern: str
    values: Mapping[str, ParameterValue]
    source: str = ""
    """Name of the file, or argument, for warnings."""

    def matches(self, fully_qualified_name: str) -> bool:
        """Return True if the pattern matches: ``/*`` stands for one token of a name, ``/**`` for any number."""
        regex = re.escape(self.pattern).replace(r"/\*", r"(/\w+)")
        # The second star of "/**" is left, and repeats the group.
        return re.fullmatch(regex.replace(r"\*", "*"), fully_qualified_name) is not None


def overrides_for(entries: Iterable[ParameterOverrides], fully_qualified_name: str) -> dict[str, ParameterValue]:
    """Return the values for one node; later entries override earlier ones."""
    matching = (entry.values for entry in entries if entry.matches(fully_qualified_name))
    return {name: value for values in matching for name, value in values.items()}


@dataclass(slots=True, eq=False)
class _OverrideSource:
    """Values of one `-p`, the values of a file for one pattern, or the overrides of one node's constructor.

    Attributes:
        store: the only node that the values are for; None: all nodes that the pattern matches.
        unused: values that were neither used nor reported.
    """

    parameters: ParameterOverrides
    store: ParameterStore | None = None
    unused: dict[str, ParameterValue] = field(default_factory=dict)
    has_matched: bool = False

    def matches(self, node: _OpenNode) -> bool:
        is_for_node = node.takes_global if self.store is None else self.store is node.store
        return is_for_node and self.parameters.matches(node.scope.node_name)


@dataclass(slots=True, eq=False)
class _OpenNode:
    """Open node, registered with its scope, which closes it.

    Attributes:
        takes_global: the values of the context are for this node, too.
    """

    scope: EntityScope
    store: ParameterStore
    may_declare_more: Callable[[], bool]
    on_close: Callable[[_OpenNode], None]
    takes_global: bool

    def close(self) -> None:
        self.on_close(self)


class InitialValues:
    """Initial values that files and arguments set for the nodes of one context."""

    def __init__(self, parameters: Sequence[ParameterOverrides]) -> None:
        self._sources = [_OverrideSource(item, unused=dict(item.values)) for item in parameters]
        self._nodes: list[_OpenNode] = []
        self._all_names: list[str] = []
        """Names of all nodes, including closed ones."""

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
        """Register a node before it declares parameters; `own` and `arguments` are from its constructor."""
        if not self._sources and not own and not arguments:
            return
        node = _OpenNode(scope, store, may_declare_more, self._on_node_close, takes_global)
        self._sources += [_OverrideSource(item, store, dict(item.values)) for item in arguments]
        if own:
            constructor = ParameterOverrides(scope.node_name, own, "parameter_overrides=")
            self._sources.append(_OverrideSource(constructor, store, dict(own)))
        self._nodes.append(node)
        self._all_names.append(scope.node_name)
        scope.register(node)

    def close(self) -> None:
        """Report values for nodes that never existed; called after all nodes are closed."""
        if self._all_names:
            self._warn_unmatched_nodes()

    def on_listed(self, store: ParameterStore) -> None:
        """Report unused values after a peer has requested the list of a node's parameters."""
        for source in list(self._sources):
            nodes = self._update(source)
            if any(node.store is store for node in nodes) and not any(node.may_declare_more() for node in nodes):
                self._warn_unused(source, nodes)

    def _on_node_close(self, closed: _OpenNode) -> None:
        for source in list(self._sources):
            nodes = self._update(source)
            if nodes and closed.store.was_refused:
                source.unused.clear()
            elif nodes == [closed]:
                self._warn_unused(source, nodes)
        self._nodes.remove(closed)

    def _update(self, source: _OverrideSource) -> list[_OpenNode]:
        """Discard the used values of a source, and return the open nodes that it matches."""
        nodes = [node for node in self._nodes if source.matches(node)]
        source.has_matched |= bool(nodes)
        for node in nodes:
            for name in node.store.used_overrides & source.unused.keys():
                del source.unused[name]
        return nodes

    def _warn_unused(self, source: _OverrideSource, nodes: list[_OpenNode]) -> None:
        node_names = ", ".join(node.scope.node_name for node in nodes)
        declared = [name for node in nodes for name in node.store.values()]
        for name, value in source.unused.items():
            if name in declared:
                reason = "which ignores initial values for it"
            else:
                reason = f"which {'declares' if len(nodes) == 1 else 'declare'} no parameter of that name"
            nodes[0].scope.logger.warning(
                f"{source.parameters.source} sets the parameter {name} = {value.value!r:.100} of {node_names}, {reason}"
                f"{did_you_mean(name, [other for other in declared if other != name])}"
            )
        source.unused.clear()

    def _warn_unmatched_nodes(self) -> None:
        """Warn about files and arguments whose node patterns have matched no node."""
        by_text: dict[str, list[_OverrideSource]] = {}
        for source in self._sources:
            source.has_matched |= any(source.matches(node) for node in self._nodes)
            by_text.setdefault(source.parameters.source, []).append(source)
        for text, sources in by_text.items():
            if any(source.has_matched or not source.unused for source in sources):
                continue
            patterns = ", ".join(dict.fromkeys(source.parameters.pattern for source in sources))
            get_root_logger().warning(
                f"{text} has parameters for {patterns}, but this process has no such node"
                f"{did_you_mean(patterns, self._all_names)}"
            )
            for source in sources:
                source.unused.clear()
