"""``security create_keystore``, ``security create_enclave`` and ``security list_enclaves``."""

from __future__ import annotations

from pathlib import Path

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

_root = click.argument("root", metavar="ROOT", type=click.Path(file_okay=False, path_type=Path))


@click.command("create_keystore")
@_root
@options.as_json
@verb
def create_keystore(root: Path, as_json: bool) -> int:
    """Create a keystore: a certificate authority and the governance.

    The governance is for the domain ROS_DOMAIN_ID: nodes are authenticated, and everything is encrypted.

    \b
    rosidl-py security create_keystore keystore
    """
    from rosidl_py_gen.ros_cli.security.keystore import Keystore
    from rosidl_py_gen.ros_cli.security.names import domain_id_from_environment

    domain_id = domain_id_from_environment()
    end = Keystore(root, terminal_output.note).create(domain_id)
    if as_json:
        terminal_output.document({"keystore": str(root), "domain_id": domain_id, "valid_until": end.isoformat()})
    else:
        terminal_output.line(f"created keystore {root} for domain {domain_id}, valid until {end:%Y-%m-%d}")
    return 0


@click.command("create_enclave")
@_root
@click.argument("name", metavar="NAME")
@options.as_json
@verb
def create_enclave(root: Path, name: str, as_json: bool) -> int:
    """Create the key, the certificate and the permissions of an enclave.

    The permissions allow all topics, services and actions in the domain ROS_DOMAIN_ID; create_permission restricts
    them. An existing key and certificate are reused.

    \b
    rosidl-py security create_enclave keystore /talker
    """
    from rosidl_py_gen.ros_cli.security import key_files
    from rosidl_py_gen.ros_cli.security.keystore import Keystore
    from rosidl_py_gen.ros_cli.security.names import check_enclave_name, domain_id_from_environment
    from rosidl_py_gen.ros_cli.security.policy import wildcard_enclave

    check_enclave_name(name)
    domain_id = domain_id_from_environment()
    keystore = Keystore(root, terminal_output.note)
    keystore.require()
    with key_files.locked(root):
        certificate = keystore.create_enclave(name)
        keystore.write_permissions(wildcard_enclave(name), certificate, domain_id)
    keystore.note_if_ungoverned(domain_id)
    folder = keystore.enclave_folder(name)
    end = certificate.not_valid_after_utc
    if as_json:
        row = {"enclave": name, "folder": str(folder), "domain_id": domain_id, "valid_until": end.isoformat()}
        terminal_output.document(row)
    else:
        terminal_output.line(f"created enclave {name} in {folder} for domain {domain_id}, valid until {end:%Y-%m-%d}")
    return 0


@click.command("list_enclaves")
@_root
@options.as_json
@verb
def list_enclaves(root: Path, as_json: bool) -> int:
    """Print the enclaves of a keystore.

    \b
    rosidl-py security list_enclaves keystore
    """
    from rosidl_py_gen.ros_cli.security.keystore import Keystore

    keystore = Keystore(root, terminal_output.note)
    keystore.require()
    rows = [{"name": name, "folder": str(keystore.enclave_folder(name))} for name in keystore.list_enclaves()]
    terminal_output.names(rows, count=False, show_types=False, as_json=as_json)
    return 0
