"""ROS arguments of a command line, between ``--ros-args`` and ``--``.

Values remain in the order of the command line, because later parameters override earlier ones.
Source: docs/internals/protocol.md 10.4.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.runtime.logs.loggers import LogLevelError, parse_level
from rosidl_py_gen.runtime.logs.outputs import LogSettings
from rosidl_py_gen.runtime.names.remapping import InvalidRemapRuleError, RemapRule, parse_remap_rule
from rosidl_py_gen.runtime.names.validation import validate_enclave
from rosidl_py_gen.runtime.parameters.initial_values import ParameterFileError, ParameterOverrides, overrides_for

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rosidl_py_gen.runtime.parameters.values import ParameterValue

_NODE_PREFIX = re.compile(r"([^:]+):(?!=)")
_SWITCH = re.compile(r"--(enable|disable)-(.*)\Z")


class RosArgumentError(RosidlError, ValueError):
    """A ROS argument cannot be parsed; the text contains it."""


@dataclass(frozen=True, slots=True)
class RosArguments:
    """Parsed command line.

    Attributes:
        program: program name and the arguments of the program.
        remap_rules: in order; the first one that matches applies.
        parameters: from ``-p`` and files, in order; later ones override earlier ones.
        warnings: sentences to log once.
    """

    program: tuple[str, ...] = ()
    remap_rules: tuple[RemapRule, ...] = ()
    parameters: tuple[ParameterOverrides, ...] = ()
    logs: LogSettings = field(default_factory=LogSettings)
    enclave: str = "/"
    warnings: tuple[str, ...] = ()

    def overrides_for(self, fully_qualified_name: str) -> dict[str, ParameterValue]:
        """Return the parameter values of a node."""
        return overrides_for(self.parameters, fully_qualified_name)


@dataclass(slots=True)
class _Parser:
    """Collected values, and one method for each flag with an argument."""

    program: list[str] = field(default_factory=list)
    remap_rules: list[RemapRule] = field(default_factory=list)
    parameters: list[ParameterOverrides] = field(default_factory=list)
    log_levels: list[tuple[str, int]] = field(default_factory=list)
    logs: dict[str, Any] = field(default_factory=dict)
    """Fields of `LogSettings` without `levels`."""
    enclave: str = "/"
    warnings: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)

    def remap(self, value: str) -> None:
        self.remap_rules.append(parse_remap_rule(value))

    def parameter(self, value: str) -> None:
        from rosidl_py_gen.runtime.parameters.files import parse_parameter_value

        left, separator, text = value.partition(":=")
        if not separator:
            raise RosArgumentError("there is no ':='; expected [NODE:]name:=value")
        prefix = _NODE_PREFIX.match(left)
        pattern = "/" + prefix.group(1).lstrip("/") if prefix else "/**"
        name = left[prefix.end() :] if prefix else left
        if not name or ":" in name or any(character.isspace() for character in name):
            raise RosArgumentError(f"{name!r} is not a parameter name; expected [NODE:]name:=value")
        self.parameters.append(ParameterOverrides(pattern, {name: parse_parameter_value(text)}, f"-p {value}"))

    def params_file(self, value: str) -> None:
        from rosidl_py_gen.runtime.parameters.files import parse_parameter_file

        try:
            text = Path(value).read_text(encoding="utf-8")
        except (OSError, ValueError) as error:
            raise RosArgumentError(f"the file cannot be read: {error}") from None
        self.parameters.extend(parse_parameter_file(text, value))

    def set_log_level(self, value: str) -> None:
        name, separator, level = value.partition(":=")
        if not separator:
            self.logs["level"] = parse_level(value)
        elif not name:
            raise RosArgumentError("the logger's name is missing; expected LEVEL or logger:=LEVEL")
        else:
            self.log_levels.append((name, parse_level(level)))

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
        self.logs["file_name"] = value


_WITH_ARGUMENT = {
    "-r": _Parser.remap,
    "--remap": _Parser.remap,
    "-p": _Parser.parameter,
    "--param": _Parser.parameter,
    "--params-file": _Parser.params_file,
    "--log-level": _Parser.set_log_level,
    "-e": _Parser.set_enclave,
    "--enclave": _Parser.set_enclave,
    "--log-config-file": _Parser.set_log_config_file,
    "--log-file-name": _Parser.set_log_file_name,
}
_SWITCHES = {"stdout-logs": "stdout", "rosout-logs": "rosout", "external-lib-logs": "external_lib"}
"""Rest of a flag after ``--enable-`` or ``--disable-`` -> the field of `LogSettings` that it sets."""


def parse_arguments(arguments: Sequence[str]) -> RosArguments:
    """Split a command line, which begins with the program name, into ROS arguments and the others.

    Raises:
        RosArgumentError: unknown flag, missing or malformed value, or unreadable file.
        TypeError: not a list of texts; a single text is not split, because the rules depend on the shell.
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
    parser = _Parser()
    rest = iter(arguments)
    for argument in rest:
        if argument == "--ros-args":
            _parse_group(parser, rest)
        elif not _parse_deprecated_remap(parser, argument):
            parser.program.append(argument)
    if parser.unknown:
        flags = " ".join(repr(argument) for argument in parser.unknown)
        known = ", ".join([*_WITH_ARGUMENT, *(f"--enable-{s}, --disable-{s}" for s in _SWITCHES)])
        raise RosArgumentError(f"unknown ROS arguments: {flags}; expected {known}; end them with '--'")
    return RosArguments(
        tuple(parser.program),
        tuple(parser.remap_rules),
        tuple(parser.parameters),
        LogSettings(levels=tuple(parser.log_levels), **parser.logs),
        parser.enclave,
        tuple(parser.warnings),
    )


def _parse_group(parser: _Parser, rest: Iterator[str]) -> None:
    for argument in rest:
        if argument == "--":
            return
        if argument == "--ros-args":
            continue
        handler = _WITH_ARGUMENT.get(argument)
        if handler is not None:
            value = next(rest, None)
            if value is None:
                raise RosArgumentError(f"ROS argument {argument} needs a value after it")
            try:
                handler(parser, value)
            except (RosArgumentError, InvalidNameError, ParameterFileError, LogLevelError) as error:
                raise RosArgumentError(f"ROS argument {argument} {value!r}: {error}") from None
        elif (switch := _SWITCH.match(argument)) and switch[2] in _SWITCHES:
            parser.logs[_SWITCHES[switch[2]]] = switch[1] == "enable"
        else:
            parser.unknown.append(argument)


def _parse_deprecated_remap(parser: _Parser, argument: str) -> bool:
    if ":=" not in argument:
        return False
    try:
        rule = parse_remap_rule(argument)
    except InvalidRemapRuleError:
        return False
    parser.remap_rules.append(rule)
    parser.warnings.append(f"remap rule {argument!r} outside of --ros-args is deprecated; use --ros-args -r {argument}")
    return True


def parse_node_arguments(arguments: Sequence[str] | None) -> RosArguments:
    """Parse the ``cli_args`` of a node, which may be None; raises like `parse_arguments`."""
    if arguments is None:
        return RosArguments()
    own = parse_arguments(arguments)
    if own.logs != LogSettings() or own.enclave != "/":
        raise RosArgumentError(
            "cli_args of a node may contain remap rules (-r) and parameters (-p, --params-file); logs and the enclave "
            "concern the whole process: pass them to Context(args=[...])"
        )
    return own
