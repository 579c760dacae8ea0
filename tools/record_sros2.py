"""Record what SROS2's own code makes, in `tests/golden/security`.

Run it in an environment with lxml and ``cryptography<43``, with the folder ``sros2`` of a checkout of ros2/sros2 on
PYTHONPATH: ``python tools/record_sros2.py CHECKOUT``. Nothing of that checkout is recorded.

- keystore.json: a keystore with four enclaves, as the content of files and the targets of links. Nobody uses its keys.
- permissions/: permissions of the enclaves in policies/fleet.xml.
- policy.xml: the policy of the nodes in graph.json; extended.xml: the same added to policies/two_grants.xml.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import types
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.sros2_keystore import FOLDER

ENCLAVES = "/", "/talker", "/listener", "/robot/arm"


def install_stubs(checkout: Path) -> None:
    """Provide what sros2 imports of a ROS installation."""

    def module(name: str, **values: Any) -> None:
        made = sys.modules[name] = types.ModuleType(name)
        vars(made).update(values)

    class Node:
        def __init__(self, _: object) -> None:
            self._nodes = json.loads((FOLDER / "graph.json").read_text())

        def __enter__(self) -> Node:
            return self

        def __exit__(self, *_: object) -> None: ...

        def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
            return [(one["name"], one["namespace"], one["enclave"]) for one in self._nodes]

        def __getattr__(self, method: str) -> Any:
            kind = {"subscriber": "subscribers", "publisher": "publishers", "service": "services", "client": "clients"}
            key = kind[method.split("_")[1]]
            return lambda name, namespace: [
                (topic, ["a/msg/B"])
                for one in self._nodes
                if (one["name"], one["namespace"]) == (name, namespace)
                for topic in one[key]
            ]

    share = str(checkout / "sros2")
    module("ament_index_python", get_package_share_directory=lambda name: share)
    module("rclpy")
    module("rclpy.exceptions", InvalidNamespaceException=ValueError)
    module("rclpy.validate_namespace", validate_namespace=lambda name: True)
    module("rclpy.utilities", get_rmw_implementation_identifier=lambda: "rmw_cyclonedds_cpp")
    module("argcomplete")
    module("argcomplete.completers", FilesCompleter=None, DirectoriesCompleter=None)
    module("ros2cli")
    module("ros2cli.node")
    module("ros2cli.node.strategy", NodeStrategy=Node, add_arguments=None)
    module("ros2cli.plugin_system", PLUGIN_SYSTEM_VERSION="0.1", satisfies_version=lambda *_: True)


def content(path: Path) -> dict[str, str]:
    return {"link": os.readlink(path)} if path.is_symlink() else {"text": path.read_text()}


def main(checkout: Path) -> None:
    install_stubs(checkout)
    from sros2 import keystore
    from sros2.verb.generate_policy import GeneratePolicyVerb

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "keystore"
        keystore.create_keystore(root)
        for name in ENCLAVES:
            keystore.create_enclave(root, name)
        files = sorted(path for path in root.rglob("*") if path.is_symlink() or path.is_file())
        recorded = {str(path.relative_to(root)): content(path) for path in files}
        (FOLDER / "keystore.json").write_text(json.dumps(recorded, indent=1) + "\n")
        shutil.rmtree(FOLDER / "permissions", ignore_errors=True)
        (FOLDER / "permissions").mkdir()
        for name in ("/fleet/camera", "/fleet/planner", "/two_grants", "/idle", "/"):
            keystore.create_enclave(root, name)
            keystore.create_permission(root, name, FOLDER / "policies/fleet.xml")
            made = (root / f"enclaves{name}" / "permissions.xml").read_text()
            (FOLDER / "permissions" / f"{name[1:].replace('/', '.') or 'root'}.xml").write_text(made)
        extended = Path(folder) / "extended.xml"
        shutil.copy(FOLDER / "policies/two_grants.xml", extended)
        for path in (Path(folder) / "policy.xml", extended):
            GeneratePolicyVerb().main(args=types.SimpleNamespace(POLICY_FILE_PATH=path))
            shutil.copy(path, FOLDER / path.name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
