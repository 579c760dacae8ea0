"""Lines of shell blocks of the documentation that no test types, each with the reason."""

from __future__ import annotations

import re

_NOT_TYPED = [
    (r"(uv )?pip install|uv (add|venv)|python3 -m venv|\. \.venv/|L=git\+", "changes the environment of the tests"),
    (r"rosidl-py-gen --install", "the tests have generated message packages"),
    (
        r"sudo |docker |ssh |git clone|twine |python -m http\.server --bind",
        "needs another machine, its user root, or the internet",
    ),
    (r"eval .*completion", "test_completion.py types it into bash and zsh"),
    (r"(export )?ROS_(STATIC_PEERS|DOMAIN_ID)=", "leaves the domain of the test"),
    (r"python bench/|python -m build", "takes minutes"),
    (r"uvicorn |curl .*localhost:8000", "the tests have no uvicorn; test_web_server_page.py calls the handlers"),
    (r"rosidl-py launch ", "the tests of launch have its packages"),
]
"""Pattern for the beginning of a line, and the reason."""

_ZENOH = "the tests of Zenoh listen on the loopback interface only"
REASONS = [_ZENOH, *(reason for _, reason in _NOT_TYPED)]


def reason_not_to_type(line: str, block: str) -> str:
    """Return why a line of a block is left out, or an empty text."""
    if "zenoh" in block:
        return _ZENOH
    return next((reason for pattern, reason in _NOT_TYPED if re.match(pattern, line)), "")


def typed(line: str) -> str:
    """Return the line as the test types it: into a folder on the path instead of the environment."""
    return line.replace(" --install", " --out installed") if line.startswith("rosidl-py-gen --path") else line
