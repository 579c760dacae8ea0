"""Settings of a context: ROS arguments of a command line, and environment variables of ROS 2 and Cyclone DDS.

ROS arguments stand between ``--ros-args`` and ``--``. Parameter values remain in the order of the command line, because
later values override earlier ones.

Environment variables set domain, discovery range, static peers, middleware and security. The rules of
security (SROS 2) are the same as in rcl and rmw_cyclonedds; but where rcl remains unsecured silently, a warning is
logged. The functions read a mapping that the caller passes, not `os.environ`.
Source: docs/internals/protocol.md 10.4, 10.6, docs/internals/dds.md 10.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.runtime.logs import LogLevelError, LogSettings, parse_level
from rosidl_py_gen.runtime.names import TOKEN_TEXT, InvalidRemapRuleError, RemapRule, parse_remap_rule, validate_enclave
from rosidl_py_gen.runtime.parameters.initial_values import ParameterFileError, ParameterOverrides, overrides_for
from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings, SecurityEnclave, SecurityError
from rosidl_py_gen.runtime.transport.cyclone import library

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

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


# ---------------------------------------------------------------------------------------------------------- environment

MAX_DOMAIN_ID = 232
"""Highest domain id with valid UDP ports: 7400 + 250 * id + 11 + 2 * 32 must be less than 65536."""
MAX_PEER_LENGTH = 255
DDS, ZENOH = "dds", "zenoh"
_RMW_TO_TRANSPORT = {
    "rmw_connextdds": DDS,
    "rmw_cyclonedds_cpp": DDS,
    "rmw_fastrtps_cpp": DDS,
    "rmw_fastrtps_dynamic_cpp": DDS,
    "rmw_zenoh_cpp": ZENOH,
}
"""Transports by value of ``RMW_IMPLEMENTATION``; all DDS implementations are interoperable, so they select the same
transport."""
SECURITY_FILES = {
    "identity_ca.cert.pem": "certificate of the CA that issues the certificates of all peers",
    "cert.pem": "certificate of the enclave",
    "key.pem": "private key of the enclave",
    "permissions_ca.cert.pem": "certificate of the CA that signs governance and permissions",
    "governance.p7s": "signed rules of the domain",
    "permissions.p7s": "signed permissions of the enclave",
}
"""Files that a security enclave (SROS 2) must have, by name, each with its purpose for error texts."""
_DISABLED = ("", "false", "0", "no", "off")
_MAX_LISTED_ENCLAVES = 5
_MAX_FOLDERS = 1000
"""Maximum number of folders of a keystore that are searched for enclaves to list in an error message."""
_UNENCRYPTED = "this process communicates unencrypted, and does not find secured nodes"


class EnvironmentSettingError(RosidlError, ValueError):
    """Exception for an invalid value of an environment variable, or of the argument of the same meaning."""


def read_environment(
    environ: Mapping[str, str], *, domain_id: int | None = None, discovery: str | None = None, distro: str | None = None
) -> DomainSettings:
    """Return the settings of a domain from environment variables; arguments that are not None override variables.

    Args:
        environ: environment variables.
        domain_id: overrides ``ROS_DOMAIN_ID``.
        discovery: overrides ``ROS_AUTOMATIC_DISCOVERY_RANGE`` and ``ROS_LOCALHOST_ONLY``.
        distro: overrides ``ROS_DISTRO``.

    Raises:
        EnvironmentSettingError: the domain id or `discovery` is invalid.
    """
    warnings: list[str] = []
    peers = _static_peers(environ.get("ROS_STATIC_PEERS", ""), warnings)
    if discovery is not None:
        discovery_range = _parse_discovery_argument(discovery)
    elif _localhost_only(environ.get("ROS_LOCALHOST_ONLY", ""), warnings):
        discovery_range, peers = DiscoveryRange.LOCALHOST, ()
    else:
        discovery_range = _parse_range_variable(environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", ""), warnings)
    if discovery_range is DiscoveryRange.OFF:
        peers = ()
    if domain_id is None:
        text = environ.get("ROS_DOMAIN_ID", "")
        domain_id = _check_domain_id("ROS_DOMAIN_ID", _parse_unsigned(text), text)
    else:
        domain_id = _check_domain_id("domain_id", domain_id, domain_id)
    distro = environ.get(Distribution.VARIABLE, "").strip().lower() if distro is None else distro
    uri = environ.get("CYCLONEDDS_URI", "")
    return DomainSettings(domain_id, discovery_range, peers, uri, tuple(warnings), ros_distro=distro)


def middleware(environ: Mapping[str, str], warn: Callable[[str], None]) -> str:
    """Return ``"dds"`` or ``"zenoh"``, according to ``RMW_IMPLEMENTATION``, else to the installed libraries."""
    name = environ.get("RMW_IMPLEMENTATION", "")
    if name in _RMW_TO_TRANSPORT:
        return _RMW_TO_TRANSPORT[name]
    if name:
        warn(f"RMW_IMPLEMENTATION={name!r:.100} ignored: unknown; expected one of {', '.join(_RMW_TO_TRANSPORT)}")
    return ZENOH if find_spec("zenoh") is not None and not library.is_found() else DDS


def _check_domain_id(origin: str, number: int | None, value: object) -> int:
    # NumPy's integers are accepted. An __index__ does not suffice: up to NumPy 2.2 its bools have one.
    if not isinstance(number, Integral) or isinstance(number, bool) or not 0 <= number <= MAX_DOMAIN_ID:
        raise EnvironmentSettingError(
            f"{origin} must be a whole number from 0 to {MAX_DOMAIN_ID} (higher ids need UDP ports above 65535), "
            f"got {value!r}"
        )
    return int(number)


def _parse_unsigned(text: str) -> int | None:
    """Parse a number like C's strtoul with base 0: decimal, hexadecimal with 0x, octal with a leading 0.

    Returns None if the text is not such a number. An empty text is 0.
    """
    digits = text.strip(" \t\n\v\f\r")
    if not digits:
        return 0 if not text else None
    if not digits.isascii() or "_" in digits:
        return None
    octal = len(digits) > 1 and digits[0] == "0" and digits.isdigit()
    try:
        return int(digits, 8 if octal else 16 if digits[:2].lower() == "0x" else 10)
    except ValueError:
        return None


def _parse_discovery_argument(discovery: str) -> DiscoveryRange:
    try:
        return DiscoveryRange(discovery.lower() if isinstance(discovery, str) else discovery)
    except ValueError:
        known = ", ".join(repr(item.value) for item in DiscoveryRange)
        raise EnvironmentSettingError(f"discovery must be one of {known}, got {discovery!r}") from None


def _parse_range_variable(value: str, warnings: list[str]) -> DiscoveryRange:
    if not value:
        return DiscoveryRange.SUBNET
    try:
        return DiscoveryRange[value.upper()]
    except KeyError:
        known = ", ".join(item.name for item in DiscoveryRange)
        warnings.append(f"ROS_AUTOMATIC_DISCOVERY_RANGE must be one of {known}, got {value!r}; using LOCALHOST")
        return DiscoveryRange.LOCALHOST


def _localhost_only(value: str, warnings: list[str]) -> bool:
    if not value:
        return False
    enabled = value.startswith("1")
    effect = "the range is LOCALHOST, static peers are ignored" if enabled else "this value has no effect"
    warnings.append(
        f"ROS_LOCALHOST_ONLY={value} is deprecated ({effect}); use ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS"
    )
    return enabled


def _static_peers(value: str, warnings: list[str]) -> tuple[str, ...]:
    peers = []
    for peer in map(str.strip, value.split(";")):
        if len(peer) > MAX_PEER_LENGTH:
            warnings.append(
                f"ROS_STATIC_PEERS: skipped a peer of {len(peer)} characters, at most {MAX_PEER_LENGTH} fit"
            )
        elif peer:
            peers.append(peer)
    return tuple(peers)


def find_security(
    environ: Mapping[str, str], enclave: str, warn: Callable[[str], None], *, is_supported: bool = True
) -> SecurityEnclave | None:
    """Return the security enclave of a context; None if the context is not secured.

    Args:
        environ: environment variables, of which the function reads ``ROS_SECURITY_...``.
        enclave: name of the enclave.
        warn: called with a sentence if the settings look secure, but the context is not.
        is_supported: False if the transport does not support security.

    Raises:
        SecurityError: security is enforced, but the enclave is incomplete or the transport does not support security;
            or a file of the enclave is damaged.
    """
    enable = environ.get("ROS_SECURITY_ENABLE", "")
    if enable != "true":
        if enable.lower() not in _DISABLED:
            warn(f"ROS_SECURITY_ENABLE={enable!r:.100} does not enable security, only 'true' does; {_UNENCRYPTED}")
        elif not enable and environ.get("ROS_SECURITY_STRATEGY") == "Enforce":
            warn(f"ROS_SECURITY_STRATEGY=Enforce has no effect without ROS_SECURITY_ENABLE=true; {_UNENCRYPTED}")
        return None
    strategy = environ.get("ROS_SECURITY_STRATEGY", "")
    is_enforced = strategy == "Enforce"
    if not is_enforced and strategy.lower() not in ("", "permissive"):
        warn(
            f"ROS_SECURITY_STRATEGY={strategy!r:.100} does not enforce security, only 'Enforce' does: nodes start "
            "unsecured if the enclave is incomplete"
        )
    try:
        problem, found = _find_folder(environ, enclave) if is_supported else ("this transport has no security", None)
    except OSError as error:  # a folder that this user may not enter, a name that is too long
        problem, found = f"{error.filename} cannot be read: {error.strerror}", None
    if found is None:
        if is_enforced:
            raise SecurityError(f"ROS_SECURITY_STRATEGY=Enforce requires a secured context, but {problem}")
        warn(
            f"ROS_SECURITY_ENABLE=true, but {problem}; {_UNENCRYPTED}. With ROS_SECURITY_STRATEGY=Enforce this is an "
            "error"
        )
        return None
    return SecurityEnclave(enclave, str(found), is_enforced)


def _find_folder(environ: Mapping[str, str], enclave: str) -> tuple[str, Path | None]:
    """Return the folder of a complete enclave, after an empty text; otherwise the reason why there is none, and None.

    Raises:
        SecurityError: a file of the enclave cannot be read or is damaged.
    """
    keystore = environ.get("ROS_SECURITY_KEYSTORE", "")
    if not keystore:
        return "ROS_SECURITY_KEYSTORE is not set; expected the folder of a keystore", None
    override = environ.get("ROS_SECURITY_ENCLAVE_OVERRIDE", "")
    root = Path(keystore) / "enclaves"
    folder = Path(f"{root}/{(override or enclave)[1:]}")  # rcl drops the first character of each override
    if override and not override.startswith("/"):
        origin = f"ROS_SECURITY_ENCLAVE_OVERRIDE={override!r:.300}, which must begin with '/'"
    else:
        origin = "ROS_SECURITY_ENCLAVE_OVERRIDE" if override else f"enclave {enclave}"
    if not folder.is_dir():
        return f"there is no folder {folder} ({origin}){_known_enclaves(root)}", None
    if not any((folder / name).exists() for name in ("cert.pem", "key.pem")):  # such as the root, which contains others
        return f"there is no enclave in {folder} ({origin}){_known_enclaves(root)}", None
    missing = [f"{name} ({purpose})" for name, purpose in SECURITY_FILES.items() if not (folder / name).is_file()]
    if missing:
        return f"{folder} ({origin}) lacks {', '.join(missing)}; create the enclave again", None
    for name, purpose in SECURITY_FILES.items():
        _check_file(folder / name, purpose)
    _check_certificates(folder)
    return "", folder


def _check_file(file: Path, purpose: str) -> None:
    """Raise `SecurityError` if a file of an enclave cannot be read or has a wrong format, which makes rcl
    fail as well.
    """
    try:
        with file.open("rb") as content:
            head = content.read(1 << 20)
    except OSError as error:
        raise SecurityError(f"{file} ({purpose}) cannot be read: {error.strerror}") from None
    expected = b"MIME-Version:" if file.suffix == ".p7s" else b"-----BEGIN "
    if expected not in head:
        kind = "S/MIME" if file.suffix == ".p7s" else "PEM"
        raise SecurityError(f"{file} ({purpose}) is not a file in {kind} format: {expected.decode()!r} is missing")


def _check_certificates(folder: Path) -> None:
    """Raise `SecurityError` if a certificate or the key of an enclave is damaged, or if key and certificate differ.

    Cyclone DDS accepts the key of another certificate, and then finds no peer.
    """
    try:
        import ssl
    except ImportError:  # a Python without OpenSSL; Cyclone DDS finds most of these faults
        return
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    certificate, key = folder / "cert.pem", folder / "key.pem"
    try:
        for name in ("identity_ca.cert.pem", "permissions_ca.cert.pem", "cert.pem"):
            damaged = f"{folder / name} ({SECURITY_FILES[name]}) is damaged"
            ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(folder / name)
        damaged = f"{key} ({SECURITY_FILES['key.pem']}) is damaged, has a password, or is not the key of {certificate}"
        context.load_cert_chain(certificate, key, password=lambda: "")
    except (ssl.SSLError, OSError, ValueError) as error:
        reason = getattr(error, "reason", "") or error
        raise SecurityError(f"{damaged}: {reason}; create the enclave again") from None


def _known_enclaves(root: Path) -> str:
    """Return a sentence for the end of an error message that lists the enclaves of a keystore."""
    if not root.is_dir():
        return f"; ROS_SECURITY_KEYSTORE={str(root.parent)!r} is not a keystore, as it has no folder enclaves"
    found: list[str] = []
    for number, (folder, _, files) in enumerate(os.walk(root)):
        if number > _MAX_FOLDERS or len(found) > _MAX_LISTED_ENCLAVES:
            break
        if "key.pem" in files:
            found.append("/" + Path(folder).relative_to(root).as_posix().strip("."))
    listed = ", ".join(sorted(found)[:_MAX_LISTED_ENCLAVES]) + (", ..." if len(found) > _MAX_LISTED_ENCLAVES else "")
    select = "select one with --enclave or ROS_SECURITY_ENCLAVE_OVERRIDE, or create this one"
    return f"; the keystore has the enclaves {listed}; {select}" if found else "; the keystore has no enclave"
