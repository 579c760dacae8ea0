"""ROS arguments of a command line, between ``--ros-args`` and ``--``.

Parameter values remain in the order of the command line, because later values override earlier ones.
Source: docs/internals/protocol.md 10.4.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.runtime.logs.loggers import LogLevelError, parse_level
from rosidl_py_gen.runtime.logs.outputs import LogSettings
from rosidl_py_gen.runtime.names.remapping import TOKEN_TEXT, InvalidRemapRuleError, RemapRule, parse_remap_rule
from rosidl_py_gen.runtime.names.validation import validate_enclave
from rosidl_py_gen.runtime.parameters.initial_values import ParameterFileError, ParameterOverrides, overrides_for

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rosidl_py_gen.runtime.parameters.files import ParameterTable
    from rosidl_py_gen.runtime.parameters.values import ParameterValue

_NODE_PREFIX = re.compile(r"([^:]+):(?!=|//)")
_PARAMETER_TOKEN = re.compile(r"(?!__)[A-Za-z_]\w*\Z", re.ASCII)
_SWITCH = re.compile(r"--(enable|disable)-(.*)\Z")


class RosArgumentError(RosidlError, ValueError):
    """Exception for a ROS argument that cannot be parsed; its text contains the argument."""


@dataclass(slots=True)
class RosArguments:
    """Parsed command line; a method for each flag with an argument adds or sets its value.

    Attributes:
        program: program name and the arguments of the program.
        remap_rules: rules of ``-r`` in order; the first rule that matches a name applies.
        parameters: values of ``-p`` and parameter files, combined as in rcl; later values override earlier ones.
        logs: settings of the log flags.
        enclave: value of ``--enclave``.
        warnings: sentences to log once.
    """

    program: list[str] = field(default_factory=list)
    remap_rules: list[RemapRule] = field(default_factory=list)
    parameters: list[ParameterOverrides] = field(default_factory=list)
    logs: LogSettings = field(default_factory=LogSettings)
    enclave: str = "/"
    warnings: list[str] = field(default_factory=list)
    _table: ParameterTable | None = field(default=None, repr=False, compare=False)

    def overrides_for(self, fully_qualified_name: str) -> dict[str, ParameterValue]:
        """Return the parameter values of ``-p`` and parameter files that apply to a node."""
        return overrides_for(self.parameters, fully_qualified_name)

    def add_remap_rule(self, value: str) -> None:
        self.remap_rules.append(parse_remap_rule(value))

    def add_parameter(self, value: str) -> None:
        left, separator, text = value.partition(":=")
        if not separator:
            raise RosArgumentError("there is no ':='; expected [NODE:]name:=value")
        prefix = _NODE_PREFIX.match(left)
        key = prefix.group(1) if prefix else "/**"
        name = left[prefix.end() :] if prefix else left
        if not _is_parameter_name(name):
            raise RosArgumentError(
                f"{name!r} is not a parameter name; expected [NODE:]name:=value with letters, digits, _, / and . in "
                "it, no digit or __ first, no ___, and no empty part; set other names in a parameter file"
            )
        if prefix and not all(TOKEN_TEXT.match(token) for token in key.removeprefix("/").split("/")):
            raise RosArgumentError(
                f"{key!r} is not the name of a node; expected [NODE:]name:=value with neither wildcards nor __ in "
                "the node; set other nodes in a parameter file"
            )
        self._parameter_table().read_argument(key, name, text, f"-p {value}")

    def add_parameter_file(self, value: str) -> None:
        try:
            text = Path(value).read_text(encoding="utf-8")
        except (OSError, ValueError) as error:
            raise RosArgumentError(f"the file cannot be read: {error}") from None
        self._parameter_table().read_file(text, value)

    def _parameter_table(self) -> ParameterTable:
        from rosidl_py_gen.runtime.parameters.files import ParameterTable

        if self._table is None:
            self._table = ParameterTable()
        return self._table

    def combine_parameters(self) -> None:
        """Set `parameters` from all parameter files and ``-p`` arguments parsed so far."""
        if self._table is not None:
            self.parameters = self._table.overrides()
            self.warnings += self._table.warnings()
            self._table = None

    def set_log_level(self, value: str) -> None:
        name, separator, level = value.partition(":=")
        if not separator:
            self.logs = replace(self.logs, level=parse_level(value))
        elif not name:
            raise RosArgumentError("the logger's name is missing; expected LEVEL or logger:=LEVEL")
        else:
            self.logs = replace(self.logs, levels=(*self.logs.levels, (name, parse_level(level))))

    def set_enclave(self, value: str) -> None:
        validate_enclave(value)
        self.enclave = value

    def set_log_config_file(self, value: str) -> None:
        raise RosArgumentError(
            "log configuration files are not supported, because they can run code (nor by spdlog, the default backend "
            "of ROS); use --log-level [logger:=]LEVEL, or configure Python's logging in the program"
        )

    def set_log_file_name(self, value: str) -> None:
        if not value or not value.isprintable() or any(sign in value for sign in "/\\:"):
            raise RosArgumentError("expected the prefix of a file name, without folder; ROS_LOG_DIR sets the folder")
        self.logs = replace(self.logs, file_name=value)


WITH_ARGUMENT = {
    "-r": RosArguments.add_remap_rule,
    "--remap": RosArguments.add_remap_rule,
    "-p": RosArguments.add_parameter,
    "--param": RosArguments.add_parameter,
    "--params-file": RosArguments.add_parameter_file,
    "--log-level": RosArguments.set_log_level,
    "-e": RosArguments.set_enclave,
    "--enclave": RosArguments.set_enclave,
    "--log-config-file": RosArguments.set_log_config_file,
    "--log-file-name": RosArguments.set_log_file_name,
}
SWITCHES = {"stdout-logs": "stdout", "rosout-logs": "rosout", "external-lib-logs": "external_lib"}
"""Fields of `LogSettings` that flags set, by the text after ``--enable-`` or ``--disable-`` in the flag."""


def parse_arguments(arguments: Sequence[str]) -> RosArguments:
    """Split a command line, which begins with the program name, into ROS arguments and other arguments.

    Raises:
        RosArgumentError: a flag is unknown, its value is missing or malformed, or a file cannot be read.
        TypeError: `arguments` is not a list of strings. A single string is not split, because quoting depends on the
            shell.
    """
    if isinstance(arguments, (str, bytes)) or not isinstance(arguments, Iterable):
        kind = "the text " if isinstance(arguments, (str, bytes)) else ""
        raise TypeError(
            f"args must be a list of arguments such as ['program', '--ros-args'], got {kind}{arguments!r:.200}"
        )
    arguments = list(arguments)  # it may be an iterator
    for argument in arguments:
        if not isinstance(argument, str):
            raise TypeError(f"args must be texts, got {argument!r}")
    parsed, unknown = RosArguments(), list[str]()
    rest = iter(arguments)
    for argument in rest:
        if argument == "--ros-args":
            unknown += _parse_group(parsed, rest)
        elif not _parse_deprecated_remap(parsed, argument):
            parsed.program.append(argument)
    parsed.combine_parameters()
    if unknown:
        flags = " ".join(map(repr, unknown))
        known = ", ".join([*WITH_ARGUMENT, *(f"--enable-{s}, --disable-{s}" for s in SWITCHES)])
        raise RosArgumentError(f"unknown ROS arguments: {flags}; expected {known}; end them with '--'")
    return parsed


def _parse_group(parsed: RosArguments, rest: Iterator[str]) -> list[str]:
    """Parse ROS arguments from the iterator `rest` up to ``--``, and return the arguments that are unknown."""
    unknown = []
    for argument in rest:
        if argument == "--":
            break
        if argument == "--ros-args":
            continue
        handler = WITH_ARGUMENT.get(argument)
        if handler is not None:
            value = next(rest, None)
            if value is None:
                raise RosArgumentError(f"ROS argument {argument} needs a value after it")
            try:
                handler(parsed, value)
            except (RosArgumentError, InvalidNameError, ParameterFileError, LogLevelError) as error:
                raise RosArgumentError(f"ROS argument {argument} {value!r}: {error}") from None
        elif (switch := _SWITCH.match(argument)) and switch[2] in SWITCHES:
            change: dict[str, Any] = {SWITCHES[switch[2]]: switch[1] == "enable"}
            parsed.logs = replace(parsed.logs, **change)
        else:
            unknown.append(argument)
    return unknown


def _is_parameter_name(name: str) -> bool:
    """Return True if rcl accepts a name in ``-p`` (`_rcl_parse_param_name`): dots separate it into non-empty parts."""
    return all(
        part and all(_PARAMETER_TOKEN.match(token) and "___" not in token for token in part.split("/") if token)
        for part in name.split(".")
    )


def _parse_deprecated_remap(parsed: RosArguments, argument: str) -> bool:
    if ":=" not in argument:
        return False
    try:
        rule = parse_remap_rule(argument)
    except InvalidRemapRuleError:
        return False
    parsed.remap_rules.append(rule)
    parsed.warnings.append(f"remap rule {argument!r} outside of --ros-args is deprecated; use --ros-args -r {argument}")
    return True


def parse_node_arguments(arguments: Sequence[str] | None) -> RosArguments:
    """Parse the ``cli_args`` of a node, which may be None.

    Raises:
        RosArgumentError: a flag is unknown, its value is missing or malformed, a file cannot be read, or a flag
            concerns the whole process (logs, enclave).
        TypeError: `arguments` is not a list of strings.
    """
    if arguments is None:
        return RosArguments()
    own = parse_arguments(arguments)
    if own.logs != LogSettings() or own.enclave != "/":
        raise RosArgumentError(
            "cli_args of a node may contain remap rules (-r) and parameters (-p, --params-file); logs and the enclave "
            "concern the whole process: pass them to Context(args=[...])"
        )
    return own
