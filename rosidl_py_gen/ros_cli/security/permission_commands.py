"""``security create_permission`` and ``security generate_artifacts``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import CommandError, options, terminal_output, verb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from click.shell_completion import CompletionItem

    from rosidl_py_gen.ros_cli.security.policy import PolicyEnclave

_KEYSTORE = "ROS_SECURITY_KEYSTORE"


def _complete_enclaves(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from click.shell_completion import CompletionItem

    from rosidl_py_gen.ros_cli.security.keystore import Keystore

    root = ctx.params.get("root")
    names = Keystore(Path(root), lambda text: None).list_enclaves() if root is not None else []
    return [CompletionItem(name) for name in names if name.startswith(incomplete)]


@click.command("create_permission")
@click.argument("root", metavar="ROOT", type=click.Path(file_okay=False, path_type=Path))
@click.argument("name", metavar="NAME", shell_complete=_complete_enclaves)
@click.argument("policy_file", metavar="POLICY_FILE_PATH", type=click.Path(dir_okay=False))
@options.as_json
@verb
def create_permission(root: Path, name: str, policy_file: str, as_json: bool) -> int:
    """Sign permissions for an enclave, made from a policy.

    The permissions are for the domain ROS_DOMAIN_ID, and replace those of the enclave.

    \b
    rosidl-py security create_permission keystore /talker policy.xml
    """
    from rosidl_py_gen.base.names import did_you_mean
    from rosidl_py_gen.ros_cli.security import key_files
    from rosidl_py_gen.ros_cli.security.keystore import Keystore
    from rosidl_py_gen.ros_cli.security.names import check_enclave_name, domain_id_from_environment
    from rosidl_py_gen.ros_cli.security.policy import read_policy

    check_enclave_name(name)
    domain_id = domain_id_from_environment()
    keystore = Keystore(root, terminal_output.note)
    keystore.require()
    policy = read_policy(policy_file)
    if name not in policy.enclaves:
        hint = did_you_mean(name, policy.enclaves) or f"; it has {', '.join(sorted(policy.enclaves)[:10])}"
        raise CommandError(f"{policy_file}: the policy has no enclave {name}{hint}")
    with key_files.locked(root):
        certificate = keystore.enclave_certificate(name)
        path = keystore.write_permissions(policy.enclaves[name], certificate, domain_id)
    keystore.note_if_ungoverned(domain_id)
    if as_json:
        terminal_output.document({"enclave": name, "permissions": str(path), "domain_id": domain_id})
    else:
        terminal_output.line(f"wrote and signed {path} for domain {domain_id}")
    return 0


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
def generate_artifacts(root: Path | None, enclaves: Sequence[str], policy_files: Sequence[str], as_json: bool) -> int:
    """Create a keystore, enclaves and permissions in one step.

    Existing keys are reused, permissions are replaced. Nothing is written if a policy is invalid.

    \b
    rosidl-py security generate_artifacts -k keystore -e /talker /listener
    rosidl-py security generate_artifacts -k keystore -p policy.xml
    """
    from rosidl_py_gen.ros_cli.security import key_files
    from rosidl_py_gen.ros_cli.security.keystore import Keystore
    from rosidl_py_gen.ros_cli.security.names import domain_id_from_environment

    if root is None:
        if not (folder := os.environ.get(_KEYSTORE, "")):
            raise CommandError(f"no keystore: {_KEYSTORE} is not set; expected -k ROOT, or the variable")
        root = Path(folder)
    domain_id = domain_id_from_environment()
    wanted = _wanted_enclaves(enclaves, policy_files)
    keystore = Keystore(root, terminal_output.note)
    if keystore.missing_files():
        keystore.create(domain_id)
        terminal_output.note(f"created keystore {root} for domain {domain_id}")
    with key_files.locked(root):
        for name, enclave in wanted.items():
            keystore.write_permissions(enclave, keystore.create_enclave(name), domain_id)
    keystore.note_if_ungoverned(domain_id)
    rows = [{"name": name, "folder": str(keystore.enclave_folder(name))} for name in wanted]
    terminal_output.names(rows, count=False, show_types=False, as_json=as_json)
    return 0


def _wanted_enclaves(names: Sequence[str], policy_files: Sequence[str]) -> dict[str, PolicyEnclave]:
    """Return the rules of all enclaves on the command line; those of a policy take precedence.

    Raises:
        CommandError: two policies have an enclave.
        DefinitionError: a policy is invalid.
        InvalidNameError: a name is invalid.
    """
    from rosidl_py_gen.ros_cli.security.names import check_enclave_name
    from rosidl_py_gen.ros_cli.security.policy import read_policy, wildcard_enclave

    for name in names:
        check_enclave_name(name)
    wanted = {name: wildcard_enclave(name) for name in names}
    origins: dict[str, str] = {}
    for path in policy_files:
        for name, enclave in read_policy(path).enclaves.items():
            if name in origins:
                raise CommandError(
                    f"enclave {name} is in {origins[name]} and in {path}; expected it in one policy, as only one can "
                    "become its permissions"
                )
            origins[name] = path
            wanted[name] = enclave
    return wanted
