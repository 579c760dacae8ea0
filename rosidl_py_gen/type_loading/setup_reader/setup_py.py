"""Reader of the arguments of `setup` in a setup.py, from its syntax tree without running it.

An interpreter executes the statements in their order, with the values that it knows. It understands functions of the
file, loops over known elements, and common functions for paths, texts and lists. Values that it cannot determine are
marked as uncertain:

- A statement or call that the interpreter does not understand makes all values uncertain that the statement can reach
  by its names.
- A branch whose condition is unknown is executed, but the values that it changes become uncertain.
- A list that is uncertain keeps its known elements.

So an argument is either right, or marked as uncertain with a reason.
"""

from __future__ import annotations

import ast
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rosidl_py_gen.compiler.frontend.package_budget import BudgetError, PackageBudget
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.type_loading.setup_reader.expressions import Expressions
from rosidl_py_gen.type_loading.setup_reader.functions import HARMLESS_MODULES, MODULES, SETUP_FUNCTIONS
from rosidl_py_gen.type_loading.setup_reader.values import DictValue, FileValue, Gap, Known, ListValue, Scope, Unknown
from rosidl_py_gen.type_loading.setup_reader.variables import FunctionReturnError, ProgramEndError

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
        except BudgetError as error:
            budget.renew()
            return _literal_arguments(tree, str(error))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError | MemoryError) else str(error)
        raise SetupSyntaxError(reason) from error


def merge_calls(calls: Sequence[Mapping[str, object]]) -> SetupArguments:
    """Merge the arguments of several calls of `setup` and return the result: lists and dicts are joined, other values
    replaced.
    """
    found = SetupArguments()
    for call in calls:
        for name, value in call.items():
            found.values[name] = _merged(found.values[name], value) if name in found.values else value
    commands = found.values.get("cmdclass", {})
    for command in sorted(_COMMANDS.intersection(commands)) if isinstance(commands, dict) else ["install"]:
        found.uncertain.setdefault("data_files", f"the command {command} of cmdclass")
    return found


def _literal_arguments(tree: ast.Module, why: str) -> SetupArguments:
    """Return the literal parts of the arguments of all calls of `setup`.

    All arguments are uncertain, for the reason `why`.
    """
    calls = []
    names = (*ARGUMENTS, "options")
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("setup", *SETUP_FUNCTIONS, "core.setup"):
            calls.append({word.arg: _literal(word.value) for word in node.keywords if word.arg in names})
    return SetupArguments(merge_calls(calls).values, dict.fromkeys(ARGUMENTS, why))


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
        found = merge_calls([{name: value for name, (value, _) in given.items()} for given, _ in self._calls])
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
