"""Commands of ``rosidl-py security``: keystores, enclaves, permissions, and policies of the nodes that are running."""

from __future__ import annotations

import os
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.terminal_text import pluralize, print_next_step
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import options, verb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import Node, NodeInfo
    from rosidl_py_gen.security import Keystore, PolicyEnclave, SecurityPolicy

_KEYSTORE = "ROS_SECURITY_KEYSTORE"
_root = click.argument("root", metavar="ROOT", type=click.Path(file_okay=False, path_type=Path))


def _domain_id() -> int:
    """Return the domain for which permissions are made: ``ROS_DOMAIN_ID``, else 0. Raises `EnvironmentSettingError`."""
    from rosidl_py_gen.runtime import read_environment

    return read_environment({"ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "")}).domain_id


def _keystore(root: Path) -> Keystore:
    from rosidl_py_gen.security import Keystore

    return Keystore(root, terminal_output.note)


@click.command("create_keystore")
@_root
@options.as_json
@verb
def create_keystore(root: Path, as_json: bool) -> None:
    """Create a keystore: a certificate authority and the governance.

    The governance is for the domain ROS_DOMAIN_ID: nodes are authenticated, and everything is encrypted.

    \b
    rosidl-py security create_keystore keystore
    """
    domain_id = _domain_id()
    end = _keystore(root).create(domain_id)
    text = f"created keystore {root} for domain {domain_id}, valid until {end:%Y-%m-%d}"
    row = {"keystore": str(root), "domain_id": domain_id, "valid_until": end.isoformat()}
    terminal_output.result([text], as_json, row)
    if not as_json:
        print_next_step("rosidl-py security create_enclave", quote(str(root)), "/NODE")


@click.command("create_enclave")
@_root
@click.argument("name", metavar="NAME")
@options.as_json
@verb
def create_enclave(root: Path, name: str, as_json: bool) -> None:
    """Create the key, the certificate and the permissions of an enclave.

    The permissions allow all topics, services and actions in the domain ROS_DOMAIN_ID; create_permission restricts
    them. An existing key and certificate are reused.

    \b
    rosidl-py security create_enclave keystore /talker
    """
    from rosidl_py_gen.security import PolicyEnclave

    enclave = PolicyEnclave.without_limits(name)
    domain_id = _domain_id()
    with _keystore(root).changing(domain_id) as keystore:
        certificate = keystore.create_enclave(name)
        keystore.write_permissions(enclave, certificate, domain_id)
    folder, end = keystore.enclave_folder(name), certificate.not_valid_after_utc
    text = f"created enclave {name} in {folder} for domain {domain_id}, valid until {end:%Y-%m-%d}"
    row = {"enclave": name, "folder": str(folder), "domain_id": domain_id, "valid_until": end.isoformat()}
    terminal_output.result([text], as_json, row)


@click.command("list_enclaves")
@_root
@options.as_json
@verb
def list_enclaves(root: Path, as_json: bool) -> None:
    """Print the enclaves of a keystore.

    \b
    rosidl-py security list_enclaves keystore
    """
    keystore = _keystore(root)
    keystore.require()
    _print_enclaves(keystore, keystore.list_enclaves(), as_json)


def _print_enclaves(keystore: Keystore, names: Sequence[str], as_json: bool) -> None:
    rows = [{"name": name, "folder": str(keystore.enclave_folder(name))} for name in names]
    terminal_output.result(names, as_json, rows)


@click.command("create_permission")
@_root
@click.argument("name", metavar="NAME", shell_complete=options.enclave_completion)
@click.argument("policy_file", metavar="POLICY_FILE_PATH", type=click.Path(dir_okay=False))
@options.as_json
@verb
def create_permission(root: Path, name: str, policy_file: str, as_json: bool) -> None:
    """Sign permissions for an enclave, made from a policy.

    The permissions are for the domain ROS_DOMAIN_ID, and replace its present permissions.

    \b
    rosidl-py security create_permission keystore /talker policy.xml
    """
    from rosidl_py_gen.base.names import did_you_mean
    from rosidl_py_gen.security import PolicyEnclave, SecurityPolicy

    PolicyEnclave.check_name(name)
    domain_id = _domain_id()
    _keystore(root).require()
    policy = SecurityPolicy.read(policy_file)
    if name not in policy.enclaves:
        hint = did_you_mean(name, policy.enclaves) or f"; it has {', '.join(sorted(policy.enclaves)[:10])}"
        raise CommandError(f"{policy_file}: the policy has no enclave {name}{hint}")
    with _keystore(root).changing(domain_id) as keystore:
        path = keystore.write_permissions(policy.enclaves[name], keystore.enclave_certificate(name), domain_id)
    row = {"enclave": name, "permissions": str(path), "domain_id": domain_id}
    terminal_output.result([f"wrote and signed {path} for domain {domain_id}"], as_json, row)


@click.command("generate_artifacts", cls=options.MultiValueCommand)
@click.option(
    "-k",
    "--keystore-root-path",
    "root",
    metavar="ROOT",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder of the keystore, created unless it exists.  [default: {_KEYSTORE}]",
)
@click.option(
    "-e",
    "--enclaves",
    cls=options.MultiValueOption,
    metavar="NAME...",
    help="Enclaves to create, which may use all topics, services and actions. May be repeated.",
)
@click.option(
    "-p",
    "--policy-files",
    cls=options.MultiValueOption,
    metavar="FILE...",
    type=click.Path(dir_okay=False),
    help="Policies, whose enclaves are created with the permissions in the policy. May be repeated.",
)
@options.as_json
@verb
def generate_artifacts(root: Path | None, enclaves: Sequence[str], policy_files: Sequence[str], as_json: bool) -> None:
    """Create a keystore, enclaves and permissions in one step.

    Existing keys are reused, permissions are replaced. Nothing is written if a policy is invalid.

    \b
    rosidl-py security generate_artifacts -k keystore -e /talker /listener
    rosidl-py security generate_artifacts -k keystore -p policy.xml
    """
    if root is None:
        if not (folder := os.environ.get(_KEYSTORE, "")):
            raise CommandError(f"no keystore: {_KEYSTORE} is not set; expected -k ROOT, or the variable")
        root = Path(folder)
    domain_id = _domain_id()
    wanted = _wanted_enclaves(enclaves, policy_files)
    keystore = _keystore(root)
    if keystore.missing_files():
        keystore.create(domain_id)
        terminal_output.note(f"created keystore {root} for domain {domain_id}")
    with _keystore(root).changing(domain_id) as keystore:
        for name, enclave in wanted.items():
            keystore.write_permissions(enclave, keystore.create_enclave(name), domain_id)
    _print_enclaves(keystore, [*wanted], as_json)


def _wanted_enclaves(names: Sequence[str], policy_files: Sequence[str]) -> dict[str, PolicyEnclave]:
    """Return policy rules by enclave, from the policy files.

    For other enclaves in `names`, the rules allow everything.
    """
    from rosidl_py_gen.security import PolicyEnclave, SecurityPolicy

    wanted = {name: PolicyEnclave.without_limits(name) for name in names}
    origins: dict[str, str] = {}
    for path in policy_files:
        for name, enclave in SecurityPolicy.read(path).enclaves.items():
            if name in origins:
                raise CommandError(
                    f"enclave {name} is in {origins[name]} and in {path}; expected it in one policy, as only one can "
                    "become its permissions"
                )
            origins[name] = path
            wanted[name] = enclave
    return wanted


@click.command("generate_policy")
@click.argument("policy_file", metavar="POLICY_FILE_PATH", type=click.Path(dir_okay=False))
@options.as_json
@options.node_verb
async def generate_policy(command_node: CommandNode, policy_file: str, as_json: bool) -> None:
    """Write a policy that allows what the running nodes do.

    An existing policy is extended. Nodes whose names begin with _ are skipped.

    \b
    rosidl-py security generate_policy policy.xml
    """
    from rosidl_py_gen.security import SecurityPolicy

    path = os.path.realpath(policy_file)
    policy = SecurityPolicy.read(policy_file) if os.path.lexists(path) else SecurityPolicy.empty()
    await command_node.wait_for_node_names()
    nodes = [one for one in command_node.node.get_nodes() if not command_node.is_hidden_node(one.fully_qualified_name)]
    added = [one for one in nodes if _add_node(policy, command_node.node, one)]
    if not added:
        domain_id = command_node.context.domain_id
        raise CommandError(f"no nodes were found in domain {domain_id}; {policy_file} was not written")
    policy.write(Path(path))
    rows = [{"name": one.fully_qualified_name, "enclave": one.enclave} for one in added]
    enclaves = ", ".join(sorted({one.enclave for one in added}))
    text = f"wrote {policy_file}: {pluralize(len(added), 'node')}, enclaves {enclaves}"
    terminal_output.result([text], as_json, {"policy": policy_file, "nodes": rows})


def _add_node(policy: SecurityPolicy, node: Node, other: NodeInfo) -> bool:
    """Add a profile of another node to a policy; returns False, with a note, if ROS does not allow its names."""
    from rosidl_py_gen.errors import InvalidNameError

    try:
        profile = policy.add_profile(other.enclave, other.namespace, other.name)
    except InvalidNameError as error:
        terminal_output.note(f"skipped node {other.fully_qualified_name}: {str(error).partition(chr(10))[0]}")
        return False
    identity = other.name, other.namespace
    for kind, attribute, found in (
        ("topics", "subscribe", node.get_subscriber_names_and_types_by_node(*identity)),
        ("topics", "publish", node.get_publisher_names_and_types_by_node(*identity)),
        ("services", "reply", node.get_service_names_and_types_by_node(*identity)),
        ("services", "request", node.get_client_names_and_types_by_node(*identity)),
    ):
        names = [name for name, _ in found if _is_valid(name)]
        if names:
            profile.allow(kind, attribute, names)
    return True


def _is_valid(name: str) -> bool:
    from rosidl_py_gen.errors import InvalidNameError
    from rosidl_py_gen.runtime import validate_full_name

    try:
        validate_full_name(name)
    except InvalidNameError as error:
        terminal_output.note(f"skipped a topic: {str(error).partition(chr(10))[0]}")
        return False
    return True
