"""A keystore that SROS2 made, recorded by `record_sros2.py`."""

from __future__ import annotations

import json
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "golden/security"


def unpack(root: Path) -> Path:
    """Write the keystore into a folder. It has the enclaves /, /talker, /listener and /robot/arm, for domain 0."""
    for name, content in json.loads((FOLDER / "keystore.json").read_text()).items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if "link" in content:
            path.symlink_to(content["link"])
        else:
            path.write_text(content["text"])
    return root
