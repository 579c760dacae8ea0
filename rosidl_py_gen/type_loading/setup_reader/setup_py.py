"""Reader of the arguments of `setup` in a setup.py, from its syntax tree without running it.

An interpreter executes the statements in their order and evaluates the expressions, with the values that it knows. It
understands functions of the file, loops over known elements, and common functions for paths, texts and lists. Values
that it cannot determine are marked as uncertain:

- A statement or call that the interpreter does not understand makes all values uncertain that the statement can reach
  by its names.
- A branch whose condition is unknown is executed, but the values that it changes become uncertain.
- A list that is uncertain keeps its known elements.

So an argument is either right, or marked as uncertain with a reason.
"""

from __future__ import annotations

import ast
import warnings
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from rosidl_py_gen.compiler.frontend import PackageBudget
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.type_loading.setup_reader.functions import (
    HARMLESS_MODULES,
    MAX_INT,
    MODULES,
    PURE_BUILTINS,
    SCOPE_FUNCTIONS,
    SETUP_FUNCTIONS,
    Words,
)
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
    Scope,
    UncertainError,
    Unknown,
    known_part,
    plain,
)
from rosidl_py_gen.type_loading.setup_reader.variables import FunctionReturnError, ProgramEndError, Variables, located

_EXITS = ("sys.exit", "builtins.exit", "builtins.quit")
_MAX_CALLS = 12
"""Maximum depth of calls of functions that the setup.py defines; a deeper call has an unknown result."""
_OBJECT_WORK = 50
"""Work that a list, generator or scope of a setup.py counts as for its memory, in characters of text."""
_HARMFUL = ("os.", "distutils.dir_util", "distutils.file_util", "distutils.spawn")
_HARMLESS = ("os.environ", "os.getenv", "os.path", "os.access", "os.uname", "os.stat", "os.cpu_count", "os.getpid")


class Expressions(Variables):
    """Evaluator of expressions, assignments and calls in a setup.py."""

    @abstractmethod
    def _run(self, body: Sequence[ast.stmt], scope: Scope) -> None:
        """Execute the statements of a block of setup.py with the variables of a scope."""

    def _value(self, node: ast.expr, scope: Scope) -> object:
        self._budget.step()
        self._line = node.lineno
        method: Callable[[ast.expr, Scope], object] | None = getattr(self, f"_value_{type(node).__name__}", None)
        if method is not None:
            return method(node, scope)
        why = self._at(f"an expression of type {type(node).__name__.lower()}")
        self._distrust(node, scope, why)
        return Unknown(why, self._scoped_names(node, scope))

    def _attempt(self, compute: Callable[[], object], used: Iterable[object], what: str) -> object:
        """Call `compute` and return its result; if it raises `UncertainError`, return `Unknown`.

        In that case the values `used` are marked as uncertain, too.
        """
        try:
            return compute()
        except UncertainError as error:
            why = located(str(error) or what, self._line)
            for one in used:
                self._touch(one, why)
            return Unknown(why, self._reach(*used), is_harmless=True)

    def _operation(self, kind: str, left: object, right: object) -> object:
        if isinstance(left, ListValue) != isinstance(right, ListValue) and kind == "Add":
            known = left if isinstance(left, ListValue) else right
            other = right if known is left else left
            assert isinstance(known, ListValue)
            why = getattr(other, "why", "") or self._at("an addition")
            self._budget.spend(8 * len(known.items))
            return ListValue([*known.items], known.is_tuple, known.why or why)
        return self._attempt(lambda: self._functions.operation(kind, left, right), (left, right), "an operator")

    def _value_Constant(self, node: ast.Constant, scope: Scope) -> object:
        is_short = not isinstance(node.value, int) or abs(node.value) <= MAX_INT
        return node.value if isinstance(node.value, PLAIN_TYPES) and is_short else Unknown(self._at("a constant"))

    def _value_Name(self, node: ast.Name, scope: Scope) -> object:
        return self._lookup(node.id, scope)

    def _value_NamedExpr(self, node: ast.NamedExpr, scope: Scope) -> object:
        value = self._value(node.value, scope)
        while scope.is_comprehension and scope.outer is not None:
            scope = scope.outer
        self._assign(node.target, value, scope)
        return value

    def _value_List(self, node: ast.List, scope: Scope) -> ListValue:
        return self._elements(node.elts, scope, is_tuple=False)

    def _value_Tuple(self, node: ast.Tuple, scope: Scope) -> ListValue:
        return self._elements(node.elts, scope, is_tuple=True)

    def _elements(self, parts: Iterable[ast.expr], scope: Scope, *, is_tuple: bool) -> ListValue:
        self._budget.spend(_OBJECT_WORK)
        found = ListValue(is_tuple=is_tuple)
        for part in parts:
            if isinstance(part, ast.Starred):
                self._functions.extend(found, self._value(part.value, scope), "")
            else:
                found.items.append(self._value(part, scope))
        return found

    def _value_Dict(self, node: ast.Dict, scope: Scope) -> DictValue:
        found = DictValue()
        for key, value in zip(node.keys, node.values, strict=True):
            name, one = self._value(key, scope) if key is not None else None, self._value(value, scope)
            if key is None and isinstance(one, DictValue):
                self._budget.spend(8 * len(one.items))
                found.items.update(one.items)
                found.why = found.why or one.why
            elif key is None or not isinstance(name, PLAIN_TYPES):
                found.why = found.why or getattr(one if key is None else name, "why", "") or self._at("a key")
                self._touch(one, found.why)
            else:
                found.items[name] = one
        return found

    def _value_BinOp(self, node: ast.BinOp, scope: Scope) -> object:
        left = self._value(node.left, scope)
        return self._operation(type(node.op).__name__, left, self._value(node.right, scope))

    def _value_UnaryOp(self, node: ast.UnaryOp, scope: Scope) -> object:
        value = self._value(node.operand, scope)
        if isinstance(node.op, ast.Not):
            test = self._truth(value)
            return Unknown(test) if isinstance(test, str) else not test
        if isinstance(node.op, ast.USub) and isinstance(value, int):
            return -value
        self._touch(value, self._at("an operator"))
        return Unknown(self._at("an operator"))

    def _value_BoolOp(self, node: ast.BoolOp, scope: Scope) -> object:
        wanted = isinstance(node.op, ast.Or)
        value = self._value(node.values[0], scope)
        for index, one in enumerate(node.values[1:], 1):
            test = self._truth(value)
            if test is wanted:
                return value
            if isinstance(test, str):
                self._doubts.append(test)
                try:
                    for other in node.values[index:]:
                        value = self._joined(value, self._value(other, scope), test)
                finally:
                    self._doubts.pop()
                return value
            value = self._value(one, scope)
        return value

    def _value_IfExp(self, node: ast.IfExp, scope: Scope) -> object:
        test = self._truth(self._value(node.test, scope))
        if isinstance(test, bool):
            return self._value(node.body if test else node.orelse, scope)
        self._doubts.append(test)
        try:
            return self._joined(self._value(node.body, scope), self._value(node.orelse, scope), test)
        finally:
            self._doubts.pop()

    def _value_Compare(self, node: ast.Compare, scope: Scope) -> object:
        values = [self._value(one, scope) for one in (node.left, *node.comparators)]
        for operator, left, right in zip(node.ops, values, values[1:], strict=False):
            used = [one for one in (left, right) if isinstance(one, Unknown | IteratorValue | FileValue)]
            result = self._attempt(partial(self._comparison, operator, left, right), used, "a comparison")
            if result is not True:
                return result
        return True

    def _comparison(self, operator: ast.cmpop, left: object, right: object) -> bool:
        if isinstance(right, IteratorValue):
            raise UncertainError("an iterator")
        first, second = plain(left, self._budget), plain(right, self._budget)
        if isinstance(second, str):
            self._budget.spend(len(second))
        try:
            match operator:
                case ast.Eq() | ast.NotEq():
                    return (first == second) is isinstance(operator, ast.Eq)
                case ast.In() | ast.NotIn() if isinstance(second, range) and not isinstance(first, int):
                    raise UncertainError("a comparison with a range")  # Python would compare each of its numbers
                case ast.In() | ast.NotIn():
                    return (first in second) is isinstance(operator, ast.In)  # type: ignore[operator]
                case ast.Is() | ast.IsNot() if second is None or isinstance(second, bool):
                    return (first is second) is isinstance(operator, ast.Is)
                case ast.Lt():
                    return bool(first < second)  # type: ignore[operator]
                case ast.LtE():
                    return bool(first <= second)  # type: ignore[operator]
                case ast.Gt():
                    return bool(first > second)  # type: ignore[operator]
                case ast.GtE():
                    return bool(first >= second)  # type: ignore[operator]
        except TypeError as error:
            raise UncertainError("a comparison") from error
        raise UncertainError("a comparison")

    def _value_JoinedStr(self, node: ast.JoinedStr, scope: Scope) -> object:
        parts = [self._value(one, scope) for one in node.values]
        used = [one for one in parts if isinstance(one, Unknown)]
        return self._attempt(lambda: self._functions.joined(map(self._functions.text_of, parts)), used, "a text")

    def _value_FormattedValue(self, node: ast.FormattedValue, scope: Scope) -> object:
        value = self._value(node.value, scope)
        if node.format_spec is not None or node.conversion not in (-1, ord("s")):
            return Unknown(self._at("a format specification"))
        return value

    def _value_Attribute(self, node: ast.Attribute, scope: Scope) -> object:
        return self._attribute(self._value(node.value, scope), node.attr)

    def _attribute(self, base: object, name: str) -> object:
        if isinstance(base, Unknown):  # the attribute may be a property
            self._touch(base, base.why)
            return base
        try:
            return self._functions.attribute(base, name)
        except UncertainError as error:
            full = str(error)
            if isinstance(base, Known):
                if full in _EXITS:
                    return Known(full)
                is_harmless = full.startswith(_HARMLESS) or not full.startswith(_HARMFUL)
                return Unknown(full, is_harmless=is_harmless)
            return Unknown(self._at(full), self._reach(base))

    def _value_Subscript(self, node: ast.Subscript, scope: Scope) -> object:
        base = self._value(node.value, scope)
        if isinstance(node.slice, ast.Slice):
            limits = (node.slice.lower, node.slice.upper, node.slice.step)
            parts = [None if one is None else self._value(one, scope) for one in limits]
            if all(part is None or isinstance(part, int) for part in parts):
                cut: slice[Any, Any, Any] = slice(*parts)
                if isinstance(base, str) and cut.step != 0:
                    self._budget.spend(len(base))
                    return base[cut]
                if isinstance(base, ListValue) and cut.step != 0:
                    self._budget.spend(8 * len(base.items))
                    return ListValue(base.items[cut], base.is_tuple, base.why)
        else:
            key = self._value(node.slice, scope)
            if isinstance(base, DictValue) and isinstance(key, PLAIN_TYPES):
                if base.has_default_list and key not in base.items and not base.why:
                    base.items[key] = ListValue()
                    base.why = self._doubt()
                if key in base.items and not base.why:
                    return base.items[key]
            items = (
                base if isinstance(base, str) else base.items if isinstance(base, ListValue) and not base.why else ()
            )
            if isinstance(key, int) and -len(items) <= key < len(items):
                return items[key]
        why = getattr(base, "why", "") or self._at("an index")
        self._touch(base, why)
        return Unknown(why, self._reach(base), is_harmless=isinstance(base, Unknown) and base.is_harmless)

    def _value_Lambda(self, node: ast.Lambda, scope: Scope) -> object:
        return self._function(node, scope)

    def _value_ListComp(self, node: ast.ListComp, scope: Scope) -> object:
        found = ListValue()
        self._functions.extend(found, IteratorValue(self._comprehension(node, node.elt, scope)), "")
        return found

    def _value_GeneratorExp(self, node: ast.GeneratorExp, scope: Scope) -> object:
        return IteratorValue(self._comprehension(node, node.elt, scope))

    def _value_DictComp(self, node: ast.DictComp, scope: Scope) -> object:
        pair = ast.copy_location(ast.Tuple([node.key, node.value], ast.Load()), node)
        found = DictValue()
        for element in self._comprehension(node, pair, scope):
            key, value = (None, None) if isinstance(element, Gap) else self._iterate(element)
            if isinstance(element, Gap) or not isinstance(key, PLAIN_TYPES):
                found.why = found.why or getattr(element, "why", "") or self._at("a key")
                self._touch(value, found.why)
            else:
                found.items[key] = value
        return found

    def _comprehension(
        self, node: ast.ListComp | ast.GeneratorExp | ast.DictComp, element: ast.expr, scope: Scope
    ) -> Iterator[object]:
        self._budget.spend(_OBJECT_WORK)
        first = self._iterate(self._value(node.generators[0].iter, scope))
        return self._generated(node.generators, element, Scope(outer=scope, is_comprehension=True), first, "")

    def _generated(
        self, generators: list[ast.comprehension], element: ast.expr, scope: Scope, source: Iterator[object], doubt: str
    ) -> Iterator[object]:
        """Yield the elements of a comprehension in setup.py.

        If `doubt` is not empty, it is the reason why none of them may exist.
        """
        here, *others = generators
        for one, why in self._each(source, doubt):
            self._budget.step()
            if isinstance(one, Gap) or here.is_async:
                why = one.why if isinstance(one, Gap) else self._at("async for")
                doubt = doubt or why
                for part in (element, *here.ifs, *others):
                    self._distrust(part, scope, why)
                yield Gap(why)
                continue
            with self._doubting(why):
                self._assign(here.target, one, scope, is_fresh=True)
            result: bool | str = True
            for test in here.ifs:
                with self._doubting(why):
                    result = self._truth(self._value(test, scope))
                if result is False:
                    break
                if isinstance(result, str):
                    why = why or result
                    yield Gap(result)
            if result is False:
                continue
            if others:
                with self._doubting(why):
                    inner = self._iterate(self._value(others[0].iter, scope))
                yield from self._generated(others, element, scope, inner, why)
            else:
                with self._doubting(why):
                    value = self._value(element, scope)
                yield value

    # --- assignments --------------------------------------------------------------------------------------------------

    def _assign(self, target: ast.expr, value: object, scope: Scope, is_fresh: bool = False) -> None:
        match target:
            case ast.Name(id=name):
                self._bind(name, value, scope, is_fresh)
            case ast.Tuple(elts=parts) | ast.List(elts=parts):
                self._unpack(parts, value, scope, is_fresh)
            case ast.Starred(value=inner):
                self._assign(inner, value, scope, is_fresh)
            case ast.Subscript(value=holder, slice=index):
                self._assign_item(self._value(holder, scope), index, value, scope)
            case _:
                self._assign_attribute(target, value, scope)

    def _unpack(self, parts: list[ast.expr], value: object, scope: Scope, is_fresh: bool) -> None:
        values = [*self._iterate(value)]
        stars = [index for index, part in enumerate(parts) if isinstance(part, ast.Starred)]
        if stars and len(values) >= len(parts) - 1 and not any(isinstance(one, Gap) for one in values):
            end = len(values) - (len(parts) - stars[0] - 1)
            values = [*values[: stars[0]], ListValue(values[stars[0] : end]), *values[end:]]
        if len(values) != len(parts) or any(isinstance(one, Gap) for one in values):
            why = self._at("an assignment to several names")
            for one in values:
                self._touch(one, why)
            values = [Unknown(why, self._reach(value))] * len(parts)
        for part, one in zip(parts, values, strict=True):
            self._assign(part, one, scope, is_fresh)

    def _assign_item(self, base: object, index: ast.expr, value: object, scope: Scope) -> None:
        why = self._doubt()
        if isinstance(index, ast.Slice):
            is_all = index.lower is None and index.upper is None and index.step is None
            if isinstance(base, ListValue) and is_all and not why and not base.why:
                more = ListValue()
                self._attempt(lambda: self._functions.extend(more, value, ""), (more, value), "a slice")
                base.items[:], base.why = more.items, more.why
                return
        else:
            key = self._value(index, scope)
            if isinstance(base, DictValue) and isinstance(key, PLAIN_TYPES):
                if why and key in base.items:
                    value = self._joined(base.items[key], value, why)
                base.items[key], base.why = value, base.why or why
                return
            items = base.items if isinstance(base, ListValue) and not why and not base.why else []
            if isinstance(key, int) and -len(items) <= key < len(items):
                items[key] = value
                return
        why = self._at("an assignment to an item")
        self._touch(base, why)
        self._touch(value, why)
        if "__dict__" in getattr(base, "why", "") or getattr(base, "why", "") == "sys.modules":
            self._lose("an assignment to variables of a module")

    def _assign_attribute(self, target: ast.expr, value: object, scope: Scope) -> None:
        base = self._value(target.value, scope) if isinstance(target, ast.Attribute) else None
        why = self._at("an assignment to an attribute")
        self._touch(base, why)
        self._touch(value, why)
        if not isinstance(base, Unknown):
            self._lose("an assignment to an attribute")

    # --- calls --------------------------------------------------------------------------------------------------------

    def _value_Call(self, node: ast.Call, scope: Scope) -> object:
        function = self._value(node.func, scope)
        args = self._elements(node.args, scope, is_tuple=True)
        words: Words = {}
        why = args.why
        for word in node.keywords:
            value = self._value(word.value, scope)
            if word.arg is not None:
                words[word.arg] = value
            elif isinstance(value, DictValue):
                words.update((str(key), one) for key, one in value.items.items())
                why = why or value.why
            else:
                why = why or getattr(value, "why", "") or self._at("keyword arguments")
                self._touch(value, why)
        self._line = node.lineno
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        is_setup = isinstance(function, Known) and function.name in SETUP_FUNCTIONS
        if is_setup or (name == "setup" and isinstance(function, Unknown)):
            doubt = next(filter(None, self._doubts), "")
            self._record(words, doubt or why or ("" if is_setup else f"{name} of another module"))
            return Unknown("setup()", is_harmless=True)
        if why:
            return self._unknown_call(Unknown(why, self._reach(function)), [function, *args.items], words, name)
        return self._call(function, args.items, words, name)

    def _call(self, function: object, args: list[object], words: Words, name: str = "a function") -> object:
        """Return the result of calling a function in setup.py.

        The result is `Unknown` if the reader does not understand the function.
        """
        if isinstance(function, FunctionValue):
            return self._call_function(function, args, words, name)
        try:
            if isinstance(function, Known):
                if self._functions.is_function(function.name):
                    return self._functions.call(function.name, args, words)
                if function.name.removeprefix("builtins.") in SCOPE_FUNCTIONS and len(args) < 2:
                    return self._lose(f"{name}()")
                if function.name in _EXITS and not self._doubt():
                    raise ProgramEndError(self._at(f"{name}()"))
                is_pure = function.name.removeprefix("builtins.") in PURE_BUILTINS
                is_pure &= not any(isinstance(one, IteratorValue | FileValue) for one in (*args, *words.values()))
                if is_pure and not self._reach(*args, *words.values()):
                    return Unknown(self._at(f"{name}()"), is_harmless=True)
            elif isinstance(function, Bound):
                return self._functions.call_method(function, args, words, self._doubt())
        except UncertainError as error:
            why = located(str(error), self._line)
            is_harmless = "not opened for reading" not in why and "working folder" not in why
            is_harmless &= not (isinstance(function, Bound) and isinstance(function.base, PurePosixPath))
            return self._unknown_call(Unknown(why, self._reach(function), is_harmless), [function, *args], words, "")
        return self._unknown_call(function, [function, *args], words, name)

    def _unknown_call(self, function: object, used: list[object], words: Words, name: str) -> Unknown:
        """Return an unknown value as result of calling code that is not understood.

        The code may change its arguments and everything they refer to, so these become uncertain.
        """
        is_harmless = isinstance(function, Unknown) and function.is_harmless
        why = self._at(f"{name}()") if name else str(getattr(function, "why", ""))
        names = self._reach(function, *used, *words.values())
        if not is_harmless:
            self._folder.changes = self._folder.changes or why
        for one in (function, *used, *words.values()):
            self._touch(one, why)
        return Unknown(why, names, is_harmless)

    def _call_function(self, function: FunctionValue, args: list[object], words: Words, name: str) -> object:
        arguments = _bound_arguments(function, args, words)
        if arguments is None or len(self._starts) >= _MAX_CALLS:
            return self._unknown_call(Unknown(self._at(f"{name}()")), [function, *args], words, name)
        node = function.node
        scope = Scope(arguments, function.scope)
        self._budget.spend(_OBJECT_WORK)
        if isinstance(node, ast.Lambda):
            self._starts.append(len(self._doubts))
            self._frames.append(scope)
            try:
                return self._value(node.body, scope)
            finally:
                self._starts.pop()
                self._frames.pop()
        for inner in _statements_of(node):
            self._budget.spend(1)
            if isinstance(inner, ast.Global):
                scope.redirected.update(dict.fromkeys(inner.names, self._module))
            elif isinstance(inner, ast.Nonlocal):
                scope.redirected.update({one: function.scope.holder(one) or scope for one in inner.names})
        self._starts.append(len(self._doubts))
        self._frames.append(scope)
        self._loops.append(len(self._doubts))
        self._doubts.append("")
        self._returned.append([])
        result: object = None
        try:
            self._run(node.body, scope)
        except FunctionReturnError as signal:
            result = signal.value
        finally:
            del self._doubts[self._loops.pop() :]
            self._starts.pop()
            self._frames.pop()
            others = self._returned.pop()
        for other in others:
            result = self._joined(other, result, self._at(f"the result of {name}()"))
        return result

    def _function(self, node: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda, scope: Scope) -> object:
        defaults = tuple(self._value(one, scope) for one in node.args.defaults)
        words = zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True)
        keyword_defaults = {word.arg: self._value(one, scope) for word, one in words if one is not None}
        is_generator = any(isinstance(one, ast.Yield | ast.YieldFrom | ast.Await) for one in ast.walk(node))
        if isinstance(node, ast.AsyncFunctionDef) or is_generator:
            reached = self._reach(*defaults, *keyword_defaults.values())
            return Unknown(self._at("a generator"), self._scoped_names(node, scope) | reached)
        return FunctionValue(node, scope, defaults, keyword_defaults)

    def _record(self, words: Words, why: str) -> None:
        """Record a call of setuptools' `setup` with the current values of its arguments.

        `why` is the reason if it may not happen.
        """
        given = {name: known_part(value, self._budget) for name, value in words.items() if value is not None}
        commands = words.get("cmdclass")
        if isinstance(commands, DictValue) and commands.why:  # any command may be in it
            given["cmdclass"] = None, commands.why
        self._calls.append((given, why))


def _statements_of(node: ast.FunctionDef) -> Iterator[ast.AST]:
    """Yield the syntax nodes in a function, except nodes inside nested functions, classes and expressions."""
    waiting: list[ast.AST] = [*node.body]
    while waiting:
        inner = waiting.pop()
        yield inner
        if not isinstance(inner, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.expr):
            waiting += ast.iter_child_nodes(inner)


def _bound_arguments(function: FunctionValue, args: list[object], words: Words) -> dict[str, object] | None:
    """Return the values of a function's parameters for a call; None if the arguments do not fit the parameters."""
    wanted = function.node.args
    names = [one.arg for one in (*wanted.posonlyargs, *wanted.args)]
    found = dict(zip(names[len(names) - len(function.defaults) :], function.defaults, strict=True))
    found |= function.keyword_defaults
    found.update(zip(names, args, strict=False))
    if wanted.vararg is not None:
        found[wanted.vararg.arg] = ListValue(args[len(names) :], is_tuple=True)
    elif len(args) > len(names):
        return None
    allowed = {*names, *(one.arg for one in wanted.kwonlyargs)}
    more = DictValue({name: value for name, value in words.items() if name not in allowed})
    if wanted.kwarg is not None:
        found[wanted.kwarg.arg] = more
    elif more.items:
        return None
    found |= {name: value for name, value in words.items() if name in allowed}
    return found if allowed <= found.keys() else None


MAX_BYTES = 128 << 10
"""Maximum characters of a setup.py that is read: its syntax tree takes up to 700 bytes for each character."""
ARGUMENTS = ("data_files", "packages", "package_dir", "py_modules", "scripts", "entry_points", "name", "version")
"""Arguments of `setup` that decide which files are installed."""
_COMMANDS = {"install", "install_data", "install_scripts", "install_lib", "build", "build_py", "develop"}
"""Commands of setuptools that a build runs. A setup.py that replaces one of them may install other files than its
arguments state."""


class SetupSyntaxError(RosidlError):
    """Error of a setup.py that is not valid Python, is nested too deeply, or is too long."""


@dataclass
class SetupArguments:
    """Arguments of all calls of `setup` in a setup.py.

    Attributes:
        values: texts, numbers, lists, and dicts with texts as keys, by argument; None for a part that is not known.
        uncertain: reasons by argument, for each of `ARGUMENTS` that may have another value.
    """

    values: dict[str, object] = field(default_factory=dict)
    uncertain: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of_calls(cls, calls: Sequence[Mapping[str, object]]) -> SetupArguments:
        """Return the arguments of several calls of `setup`, merged: lists and dicts are joined, others replaced."""
        found = cls()
        for call in calls:
            for name, value in call.items():
                found.values[name] = _merged(found.values[name], value) if name in found.values else value
        commands = found.values.get("cmdclass", {})
        for command in sorted(_COMMANDS.intersection(commands)) if isinstance(commands, dict) else ["install"]:
            found.uncertain.setdefault("data_files", f"the command {command} of cmdclass")
        return found


def read_setup_py(text: str, folder: Path, budget: PackageBudget) -> SetupArguments:
    """Return the arguments of `setup` in a setup.py.

    If reading takes too much work, only their literal parts are known.

    Raises:
        SetupSyntaxError: the text is not Python, nested too deeply, or too long.
        UnreadableError: a folder of the package cannot be read.
    """
    if len(text) > MAX_BYTES:
        raise SetupSyntaxError(f"the file is longer than {MAX_BYTES} characters")
    try:
        with warnings.catch_warnings():  # of escapes in texts
            warnings.simplefilter("ignore")
            tree = ast.parse(text)
        try:
            return _Interpreter(folder, budget).arguments(tree)
        except PackageBudget.ExceededError as error:
            budget.renew()
            return _literal_arguments(tree, str(error))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError | MemoryError) else str(error)
        raise SetupSyntaxError(reason) from error


def _literal_arguments(tree: ast.Module, why: str) -> SetupArguments:
    """Return the literal parts of the arguments of all calls of `setup`.

    All arguments are uncertain, for the reason `why`.
    """
    calls = []
    names = (*ARGUMENTS, "options")
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("setup", *SETUP_FUNCTIONS, "core.setup"):
            calls.append({word.arg: _literal(word.value) for word in node.keywords if word.arg in names})
    return SetupArguments(SetupArguments.of_calls(calls).values, dict.fromkeys(ARGUMENTS, why))


def _literal(node: ast.expr) -> object:
    """Return the value of a literal in a syntax tree; parts that are not literals become None."""
    match node:
        case ast.Constant(value=str() | int() as value):
            return value
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            return [_literal(part) for part in parts]
        case ast.Dict(keys=keys, values=values):
            pairs = zip(keys, values, strict=True)
            return {str(key.value): _literal(value) for key, value in pairs if isinstance(key, ast.Constant)}
    return None


class _Break(Exception):
    pass


class _Continue(Exception):
    pass


class _Interpreter(Expressions):
    def arguments(self, tree: ast.Module) -> SetupArguments:
        try:
            self._run(tree.body, self._module)
        except ProgramEndError as stop:
            self._lost = self._lost or ("" if self._calls else str(stop))
        except (FunctionReturnError, _Break, _Continue):  # not valid there
            self._lost = self._lost or "statements outside of functions and loops"
        found = SetupArguments.of_calls(
            [{name: value for name, (value, _) in given.items()} for given, _ in self._calls]
        )
        doubts = [why for _, why in self._calls]
        if not self._calls:
            doubts.append(self._lost or "no call of setup that can be read")
        elif len(self._calls) > 1:
            doubts.append("several calls of setup")
        for name in ARGUMENTS:
            reasons = (self._lost or given[name][1] for given, _ in self._calls if name in given)
            if why := next(filter(None, (*doubts, *reasons)), ""):
                found.uncertain[name] = why
        options = next((given["options"][1] for given, _ in self._calls if "options" in given), "")
        for name in ("entry_points", "scripts") if options else ():  # their folder is an option
            found.uncertain.setdefault(name, options)
        return found

    def _run(self, body: Sequence[ast.stmt], scope: Scope) -> None:
        for node in body:
            self._budget.step()
            self._line = node.lineno
            method = getattr(self, f"_run_{type(node).__name__}", None)
            if method is not None:
                method(node, scope)
            else:
                self._run_unknown(node, scope)

    def _run_unknown(self, node: ast.stmt, scope: Scope) -> None:
        why = self._at(f"the statement {type(node).__name__.lower()}")
        self._distrust(node, scope, why)
        bodies = [inner.body for inner in ast.iter_child_nodes(node) if isinstance(inner, ast.match_case)]
        if isinstance(node, ast.AsyncFor | ast.AsyncWith):
            bodies.append(node.body)
        for body in bodies:
            self._doubtful(body, scope, why)
        self._distrust(node, scope, why)

    def _doubtful(self, body: Sequence[ast.stmt], scope: Scope, why: str) -> None:
        """Execute statements of setup.py that may be skipped or repeated when it runs, for the reason `why`."""
        self._doubts.append(why)
        try:
            self._run(body, scope)
        finally:
            self._doubts.pop()

    def _run_Pass(self, node: ast.Pass, scope: Scope) -> None:
        pass

    _run_Global = _run_Nonlocal = _run_Pass  # the function has read them

    def _run_Expr(self, node: ast.Expr, scope: Scope) -> None:
        self._value(node.value, scope)

    def _run_Assert(self, node: ast.Assert, scope: Scope) -> None:
        self._value(node.test, scope)

    def _run_Assign(self, node: ast.Assign, scope: Scope) -> None:
        value = self._value(node.value, scope)
        for target in node.targets:
            self._assign(target, value, scope)

    def _run_AnnAssign(self, node: ast.AnnAssign, scope: Scope) -> None:
        if node.value is not None:
            self._assign(node.target, self._value(node.value, scope), scope)

    def _run_AugAssign(self, node: ast.AugAssign, scope: Scope) -> None:
        if any(isinstance(one, ast.Call) for one in ast.walk(node.target)):  # it would be called twice
            return self._run_unknown(node, scope)
        target = ast.copy_location(_loaded(node.target), node)
        old, more = self._value(target, scope), self._value(node.value, scope)
        if isinstance(node.op, ast.Add) and isinstance(old, ListValue) and not old.is_tuple:
            self._attempt(lambda: self._functions.extend(old, more, self._doubt()), (old, more), "an addition")
            self._assign(node.target, old, scope)
        else:
            result = self._operation(type(node.op).__name__, old, more)
            if isinstance(old, DictValue) and isinstance(result, DictValue):  # in place
                old.items, old.why = result.items, result.why or self._doubt()
                result = old
            elif isinstance(old, DictValue) or (isinstance(old, ListValue) and not old.is_tuple):
                self._touch(old, self._at("an operator"))
            self._assign(node.target, result, scope)

    def _run_Delete(self, node: ast.Delete, scope: Scope) -> None:
        for target in node.targets:
            if isinstance(target, ast.Name):
                holder = scope.redirected.get(target.id, scope)
                if self._doubt():
                    self._touch(holder.names.get(target.id), self._doubt())
                else:
                    holder.names.pop(target.id, None)
            else:
                self._distrust(target, scope, self._at("del"))

    def _run_Import(self, node: ast.Import, scope: Scope) -> None:
        for one in node.names:
            root = one.name.partition(".")[0]
            self._bind(one.asname or root, self._module_value(one.name if one.asname else root), scope)
            self._module_value(one.name)

    def _run_ImportFrom(self, node: ast.ImportFrom, scope: Scope) -> None:
        module = (node.module or "").replace("posixpath", "os.path")
        value = Unknown(self._own_import(module)) if node.level else self._module_value(module)
        for one in node.names:
            if one.name == "*":
                if not isinstance(value, Known) or module.partition(".")[0] not in (*MODULES, *HARMLESS_MODULES):
                    self._lose(f"the import of all names of {module}")
                continue
            if isinstance(value, Known):
                self._bind(one.asname or one.name, self._attribute(value, one.name), scope)
            else:
                self._bind(one.asname or one.name, Unknown(f"{one.name} of {module or '.'}"), scope)

    def _module_value(self, name: str) -> object:
        root = name.partition(".")[0]
        is_own = any(self._folder.check("isfile", place) for place in (f"{root}.py", f"{root}/__init__.py"))
        if (is_own and root not in ("os", "sys", "builtins")) or (
            root not in HARMLESS_MODULES and self._folder.check("isdir", root)
        ):
            return Unknown(self._own_import(name))
        if root in HARMLESS_MODULES:
            return Known(name.replace("posixpath", "os.path"))
        return Unknown(f"the module {name}", is_harmless=root in ("numpy", "catkin_pkg", "torch"))

    def _own_import(self, name: str) -> str:
        """Handle the import of a module of the package itself, which may change files: doubt all files.

        Returns the reason, "the import of NAME".
        """
        why = self._at(f"the import of {name or '.'}")
        self._folder.changes = self._folder.changes or why
        return why

    def _run_FunctionDef(self, node: ast.FunctionDef, scope: Scope) -> None:
        decorators = [self._value(one, scope) for one in node.decorator_list]
        value = self._function(node, scope)
        for decorator in reversed(decorators):
            value = self._call(decorator, [value], {}, "a decorator")
        self._bind(node.name, value, scope)

    _run_AsyncFunctionDef = _run_FunctionDef

    def _run_ClassDef(self, node: ast.ClassDef, scope: Scope) -> None:
        why = self._at(f"the class {node.name}")
        for one in (*node.decorator_list, *node.bases, *(word.value for word in node.keywords)):
            self._touch(self._value(one, scope), why)
        inner = Scope(outer=scope)
        self._run(node.body, inner)
        for value in inner.names.values():
            if isinstance(value, Unknown):  # its class may have __set_name__
                self._touch(value, why)
        if "__del__" in inner.names:  # it is called at any time
            self._lose("__del__")
        self._bind(node.name, Unknown(self._at(f"the class {node.name}"), self._scoped_names(node, scope)), scope)

    def _run_If(self, node: ast.If, scope: Scope) -> None:
        test = self._truth(self._value(node.test, scope))
        if isinstance(test, bool):
            return self._run(node.body if test else node.orelse, scope)
        for body in (node.body, node.orelse):
            self._doubtful(body, scope, test)

    def _run_For(self, node: ast.For, scope: Scope) -> None:
        self._loop(node, scope, self._iterate(self._value(node.iter, scope)))

    def _loop(self, node: ast.For | ast.While, scope: Scope, elements: Iterator[object]) -> None:
        """Execute the body of a loop in setup.py for each element, and then its ``else`` block."""
        self._loops.append(len(self._doubts))
        self._doubts.append("")
        try:
            for element in elements:
                self._budget.step()
                if isinstance(element, Gap):
                    self._doubts[self._loops[-1]] = self._doubts[self._loops[-1]] or element.why
                    self._distrust(node, scope, element.why)
                    element = Unknown(element.why)
                if isinstance(node, ast.For):
                    self._assign(node.target, element, scope, is_fresh=True)
                try:
                    self._run(node.body, scope)
                except _Continue:
                    pass
                except _Break:
                    return
            why = self._doubts[self._loops[-1]]
        finally:
            del self._doubts[self._loops.pop() :]
            if self._doubt() and isinstance(node, ast.For):  # the loop may not be executed
                self._distrust(node.target, scope, self._doubt())
        if why:
            self._distrust(node, scope, why)
        self._doubtful(node.orelse, scope, why)

    def _run_While(self, node: ast.While, scope: Scope) -> None:
        self._loop(node, scope, self._tests(node.test, scope))

    def _tests(self, test: ast.expr, scope: Scope) -> Iterator[object]:
        """Yield None for each pass of a while loop in setup.py.

        If it is unknown whether the loop continues, yield one `Gap` and stop.
        """
        while (result := self._truth(self._value(test, scope))) is not False:
            if isinstance(result, str):
                yield Gap(result)
                return
            yield None

    def _run_Break(self, node: ast.Break, scope: Scope) -> None:
        self._leave(_Break())

    def _run_Continue(self, node: ast.Continue, scope: Scope) -> None:
        self._leave(_Continue())

    def _run_Return(self, node: ast.Return, scope: Scope) -> None:
        value = self._value(node.value, scope) if node.value is not None else None
        self._leave(FunctionReturnError(value))

    def _leave(self, signal: _Break | _Continue | FunctionReturnError) -> None:
        """Raise `signal`, which leaves a loop or function of setup.py.

        If it is not certain that it is left, continue with a doubt instead.
        """
        if isinstance(signal, FunctionReturnError):
            start = self._starts[-1] if self._starts else 0
            # Every loop of the call, and the call itself, may be left here.
            positions = [position for position in self._loops if position >= start]
        else:
            positions = self._loops[-1:]
            start = positions[0] if positions else 0
        why = next(filter(None, self._doubts[start:]), "")
        if not why:
            raise signal
        for position in positions:
            self._doubts[position] = self._doubts[position] or why
        if isinstance(signal, FunctionReturnError) and self._returned:
            self._returned[-1].append(signal.value)

    def _run_Raise(self, node: ast.Raise, scope: Scope) -> None:
        if node.exc is not None:
            self._touch(self._value(node.exc, scope), self._at("raise"))
        if not self._doubt():
            raise ProgramEndError(self._at("raise"))

    def _run_With(self, node: ast.With, scope: Scope) -> None:
        is_file = True
        for item in node.items:
            value = self._value(item.context_expr, scope)
            is_file &= isinstance(value, FileValue) or _is_open(item.context_expr)
            if item.optional_vars is not None:
                self._assign(item.optional_vars, value, scope)
        if is_file:
            self._run(node.body, scope)
        else:
            why = self._at("with")
            self._doubtful(node.body, scope, why)
            self._distrust(node, scope, why)

    def _run_Try(self, node: ast.Try, scope: Scope) -> None:
        if all(isinstance(one, ast.Import | ast.ImportFrom) for one in node.body) and self._imports_known(node.body):
            self._run(node.body, scope)
            self._run(node.orelse, scope)
        else:
            why = self._at("try")
            for body in (node.body, *(handler.body for handler in node.handlers), node.orelse):
                self._doubtful(body, scope, why)
            for handler in node.handlers:
                if handler.name:
                    scope.names.pop(handler.name, None)
        self._run(node.finalbody, scope)

    _run_TryStar = _run_Try

    def _imports_known(self, body: Sequence[ast.stmt]) -> bool:
        """Return True if a block imports only modules that exist in every environment."""
        names: list[str] = []
        for node in body:
            if isinstance(node, ast.ImportFrom):
                names.append(node.module or "." if not node.level else ".")
            elif isinstance(node, ast.Import):
                names += (one.name for one in node.names)
        return all(name.partition(".")[0] in HARMLESS_MODULES for name in names)


def _loaded(target: ast.expr) -> ast.expr:
    """Return an expression in setup.py that reads the target of an assignment."""
    match target:
        case ast.Name(id=name):
            return ast.Name(name, ast.Load())
        case ast.Attribute(value=value, attr=name):
            return ast.Attribute(value, name, ast.Load())
        case ast.Subscript(value=value, slice=index):
            return ast.Subscript(value, index, ast.Load())
    return target


def _is_open(node: ast.expr) -> bool:
    """Return True for a call of `open`; as a context manager, its file never hides an exception."""
    called = node.func if isinstance(node, ast.Call) else None
    return getattr(called, "id", getattr(called, "attr", "")) == "open"


def _merged(old: object, new: object) -> object:
    """Return the value of an argument that two calls of `setup` have: joined lists or dicts, else the value of the
    second call.
    """
    if isinstance(old, list) and isinstance(new, list):
        return old + new
    if isinstance(old, dict) and isinstance(new, dict):
        return {
            key: _merged(old[key], new[key]) if key in old and key in new else (old | new)[key] for key in old | new
        }
    return new
