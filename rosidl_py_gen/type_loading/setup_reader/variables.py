"""Variables of a setup.py that is read without running it, and the reasons why their values are uncertain."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from rosidl_py_gen.compiler.frontend import PackageBudget
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.type_loading.setup_reader.functions import (
    HARMLESS_BUILTINS,
    SETUP_FUNCTIONS,
    Functions,
    InterpreterMethods,
    Words,
)
from rosidl_py_gen.type_loading.setup_reader.package_folder import PackageFolder
from rosidl_py_gen.type_loading.setup_reader.values import (
    PLAIN_TYPES,
    Bound,
    DictValue,
    FileValue,
    FunctionValue,
    Gap,
    IteratorValue,
    Known,
    ListValue,
    Names,
    Scope,
    UncertainError,
    Unknown,
    ViewValue,
)


class ProgramEndError(RosidlError):
    """Exception that ends the execution of a setup.py; the text is the reason."""


class FunctionReturnError(RosidlError):
    """Exception that ends the execution of a function of setup.py, which returns `value`."""

    def __init__(self, value: object) -> None:
        self.value = value


class Variables:
    """Values of the variables in a setup.py, and the reasons why they are uncertain."""

    def __init__(self, folder: Path, budget: PackageBudget) -> None:
        self._budget = budget
        self._folder = PackageFolder(folder, budget)
        reader = InterpreterMethods(self._iterate, self._each, self._call, self._doubting, self._touch)
        self._functions = Functions(self._folder, budget, reader)
        self._module = Scope({"__name__": "__main__", "__file__": f"{self._folder.real}/setup.py", "__doc__": ""})
        self._doubts: list[str] = []  # reasons of the blocks that are executed; empty texts for loops and calls
        self._loops: list[int] = []  # positions in `_doubts` of the loops and calls that are executed
        self._starts: list[int] = []  # positions in `_doubts` of the calls that are executed
        self._frames: list[Scope] = []  # scopes of the calls that are executed
        self._returned: list[list[object]] = []  # values that the calls may return
        self._lost = ""  # reason why every variable is uncertain
        self._calls: list[tuple[dict[str, tuple[object, str]], str]] = []
        self._mentioned: dict[int, tuple[ast.AST, frozenset[str]]] = {}
        self._line = 0

    def _call(self, function: object, args: list[object], words: Words, name: str = "") -> object:
        """Return the result of calling a function of setup.py with positional arguments and the keyword arguments
        `words`.
        """
        raise NotImplementedError

    def _doubt(self) -> str:
        """Return the reason why the current statement of setup.py may be skipped or repeated.

        Returns "" if it is certainly executed once.
        """
        return self._lost or next(filter(None, self._doubts), "")

    @contextmanager
    def _doubting(self, why: str) -> Iterator[None]:
        """Evaluate the block as code that may be skipped when setup.py runs, for the reason `why`.

        If `why` is empty, the block is evaluated as code that is not skipped.
        """
        if why:
            self._doubts.append(why)
        try:
            yield
        finally:
            if why:
                self._doubts.pop()

    def _at(self, what: str) -> str:
        return f"{what} in line {self._line}"

    def _lose(self, what: str) -> Unknown:
        self._lost = self._lost or self._at(what)
        self._folder.changes = self._folder.changes or self._lost
        return Unknown(self._lost)

    def _names_in(self, node: ast.AST) -> frozenset[str]:
        """Return the names of all variables that a syntax node mentions."""
        if id(node) not in self._mentioned:
            names = set()
            for inner in ast.walk(node):
                self._budget.step()
                if isinstance(inner, ast.Name):
                    names.add(inner.id)
                elif isinstance(inner, ast.Global | ast.Nonlocal):
                    names.update(inner.names)
            self._mentioned[id(node)] = node, frozenset(names)
        return self._mentioned[id(node)][1]

    def _touch(self, value: object, why: str) -> None:
        """Mark a value of setup.py, and all values that can be reached from it, as uncertain for the reason `why`."""
        waiting = [value]
        visited: dict[int, object] = {}  # with the objects, so that no other object gets the number
        while waiting:
            one = waiting.pop()
            if isinstance(one, PLAIN_TYPES) or id(one) in visited:
                continue
            self._budget.step()
            visited[id(one)] = one
            if isinstance(one, ListValue):
                one.why = one.why or why
                waiting += one.items
            elif isinstance(one, DictValue):
                one.why = one.why or why
                waiting += one.items.values()
            elif isinstance(one, Bound | ViewValue):
                waiting.append(one.base)
            elif isinstance(one, IteratorValue):  # its elements belong to other values
                with self._doubting(why):
                    waiting += self._consume(one)
            elif isinstance(one, FileValue):
                one.why = one.why or why
            elif isinstance(one, FunctionValue):
                waiting += self._values_of((name, one.scope) for name in self._names_in(one.node))
                waiting += one.defaults
                waiting += one.keyword_defaults.values()
                self._forget_globals(one.node, why)
            elif isinstance(one, Unknown):
                waiting += self._values_of(one.names)

    def _values_of(self, names: Iterable[tuple[str, Scope]]) -> list[object]:
        found = []
        for name, scope in names:
            self._budget.step()
            if (holder := scope.holder(name)) is not None:
                found.append(holder.names[name])
        return found

    def _forget_globals(self, node: ast.AST, why: str) -> None:
        """Mark the module's variables that a function of setup.py assigns by ``global`` or ``nonlocal`` as
        uncertain.
        """
        for inner in ast.walk(node):
            self._budget.step()
            if isinstance(inner, ast.Global | ast.Nonlocal):
                for name in inner.names:
                    if (value := self._module.names.get(name)) is not None:
                        self._module.names[name] = self._joined(value, Unknown(why), why)

    def _distrust(self, node: ast.AST, scope: Scope, why: str) -> None:
        """Mark all variables and values that a statement of setup.py may change as uncertain for the reason `why`."""
        for value in self._values_of((name, scope) for name in self._names_in(node)):
            self._touch(value, why)
        for inner in ast.walk(node):
            self._budget.step()
            if isinstance(inner, ast.Name) and not isinstance(inner.ctx, ast.Load):
                holder = scope.redirected.get(inner.id, scope)
                value = holder.names.get(inner.id, Unknown(why))
                holder.names[inner.id] = self._joined(value, Unknown(why), why)

    def _joined(self, old: object, new: object, why: str) -> object:
        """Return the value of a variable of setup.py after two branches.

        It is uncertain unless both branches give the same value.
        """
        if old is new or (isinstance(old, PLAIN_TYPES) and type(old) is type(new) and old == new):
            return new
        self._touch(old, why)
        self._touch(new, why)
        if isinstance(old, Known) and isinstance(new, Known) and {old.name, new.name} <= {*SETUP_FUNCTIONS}:
            return new
        if isinstance(old, ListValue) or isinstance(new, ListValue):
            first, second = (one.items if isinstance(one, ListValue) else [] for one in (old, new))
            self._budget.spend(8 * (len(first) + len(second)))
            known = {*map(id, second)}
            return ListValue([*(one for one in first if id(one) not in known), *second], why=why)
        if isinstance(old, DictValue) and isinstance(new, DictValue):
            self._budget.spend(8 * (len(old.items) + len(new.items)))
            return DictValue({**old.items, **new.items}, why=why)
        return Unknown(why, self._reach(old, new))

    def _scoped_names(self, node: ast.AST, scope: Scope) -> Names:
        names = self._names_in(node)
        self._budget.spend(len(names))
        return frozenset((name, scope) for name in names)

    def _reach(self, *values: object) -> Names:
        """Return the names of the variables that code which is not understood may change if these values are passed to
        it.
        """
        names: Names = frozenset()
        for value in values:
            if isinstance(value, Unknown):
                names |= value.names
            elif isinstance(value, FunctionValue):
                names |= self._scoped_names(value.node, value.scope)
            elif isinstance(value, Bound | ViewValue):
                names |= self._reach(value.base)
            elif isinstance(value, ListValue | DictValue):
                self._budget.spend(len(value.items))
                parts = value.items.values() if isinstance(value, DictValue) else value.items
                names |= self._reach(*(one for one in parts if not isinstance(one, PLAIN_TYPES)))
        return names

    def _bind(self, name: str, value: object, scope: Scope, is_fresh: bool = False) -> None:
        """Assign a value to a variable of setup.py.

        If the assignment may be skipped, the variable may also have its old value. A `fresh` variable has no old value:
        it is the target of a loop or comprehension.
        """
        holder = scope.redirected.get(name, scope)
        why = self._doubt() if not is_fresh else ""
        if why and self._frames and holder is scope is self._frames[-1] and not self._lost:
            # Variables of a call are new; only a doubt inside of the call matters.
            why = next(filter(None, self._doubts[self._starts[-1] :]), "")
        if why and (name in holder.names or hasattr(builtins, name)):
            value = self._joined(self._lookup(name, holder), value, why)
        holder.names[name] = value

    def _lookup(self, name: str, scope: Scope) -> object:
        if (holder := scope.holder(name)) is not None:
            return holder.names[name]
        if self._functions.is_function(f"builtins.{name}"):
            return Known(f"builtins.{name}")
        if name in HARMLESS_BUILTINS:
            return Unknown(f"{name}()", is_harmless=True)
        if name in ("setup", "find_packages", "find_namespace_packages"):  # of an import of all names
            return Known(f"setuptools.{name}")
        if hasattr(builtins, name):
            return Known(f"builtins.{name}")
        return Unknown(f"the name {name}")

    def _truth(self, value: object) -> bool | str:
        """Return the truth of a value of setup.py as a bool; if the truth is not known, return the reason as a text."""
        if isinstance(value, PLAIN_TYPES):
            return bool(value) if not isinstance(value, PurePosixPath) else True
        if isinstance(value, ListValue | DictValue) and not value.why:
            return bool(value.items)
        if isinstance(value, ViewValue):
            return self._truth(value.base)
        if isinstance(value, FunctionValue | FileValue | Known | IteratorValue):
            return True
        why = getattr(value, "why", "")
        self._touch(value, why)
        return located(why, self._line) if why else self._at("a condition")

    def _iterate(self, value: object) -> Iterator[object]:
        """Yield the elements of a value in a setup.py, with a `Gap` for unknown elements."""
        if isinstance(value, ListValue):
            index, has_gap = 0, False
            while True:  # it may grow, and become uncertain
                self._budget.step()
                if value.why and not has_gap:
                    has_gap = True
                    yield Gap(value.why)
                if index >= len(value.items):
                    return
                yield value.items[index]
                index += 1
        elif isinstance(value, IteratorValue):
            yield from self._consume(value)
        elif isinstance(value, DictValue):
            if value.why:
                yield Gap(value.why)
            yield from [*value.items]
        elif isinstance(value, ViewValue):
            if value.base.why:
                yield Gap(value.base.why)
            for key, one in [*value.base.items.items()]:
                self._budget.step()
                yield {"keys": key, "values": one}.get(value.kind, ListValue([key, one], is_tuple=True))
        elif isinstance(value, str | range):
            for element in value:
                self._budget.step()
                yield element
        elif isinstance(value, FileValue):
            yield from self._lines(value)
        else:
            self._touch(value, getattr(value, "why", ""))
            yield Gap(located(getattr(value, "why", "") or "an iteration", self._line))

    def _consume(self, value: IteratorValue) -> Iterator[object]:
        """Yield the elements of an iterator of setup.py.

        If this may be skipped when setup.py runs, the elements may still be in it.
        """
        while not (why := self._doubt()):
            self._budget.step()
            try:
                element = next(value.elements, self)
            except (UncertainError, ValueError) as error:  # ValueError: the generator is running
                yield Gap(located(str(error), self._line))
                return
            if element is self:
                return
            yield element
        others: list[object] = []
        try:
            for element in value.elements:
                self._budget.step()
                others.append(element)
        except (UncertainError, ValueError) as error:
            others.append(Gap(located(str(error), self._line)))
        value.elements = iter([Gap(why), *(one for one in others if not isinstance(one, Gap))])
        yield from others

    def _lines(self, file: FileValue) -> Iterator[object]:
        """Yield the remaining lines of a file of setup.py.

        If this may be skipped when setup.py runs, the lines may still be unread.
        """
        if file.why:
            yield Gap(file.why)
            return
        while file.position < len(file.text):
            self._budget.step()
            if why := self._doubt():
                start, file.position, file.why = file.position, len(file.text), why
                yield from self._functions.lines(file.text[start:])
                return
            start = file.position
            file.position = (file.text.find("\n", start) + 1) or len(file.text)
            self._budget.spend(file.position - start)
            yield file.text[start : file.position]

    def _each(self, source: Iterator[object], why: str = "") -> Iterator[tuple[object, str]]:
        """Yield the elements of an iterator, each with the reason why it may be missing.

        After unknown elements, every element may be missing.
        """
        while True:
            with self._doubting(why):
                element = next(source, self)
            if element is self:
                return
            if isinstance(element, Gap):
                why = why or element.why
            yield element, why


def located(why: str, line: int) -> str:
    return why if " in line " in why or not line else f"{why} in line {line}"
