"""A headless Chromium for tests, driven over WebDriver, which is plain HTTP with JSON."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import re
import shutil
import subprocess
import time
import urllib.request
from typing import TYPE_CHECKING, Any

import pytest

from support.environments import missing_peer

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--window-size=800,600"),
)
_direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))


class Browser:
    """Window of a browser; `driver` is the address of a chromedriver."""

    def __init__(self, driver: str, profile: Path) -> None:
        options = {"args": [*_OPTIONS, f"--user-data-dir={profile}"], "binary": shutil.which("chromium")}
        wanted = {"capabilities": {"alwaysMatch": {"goog:chromeOptions": options}}}
        self._session = f"{driver}/session"
        self._session += "/" + self._ask("POST", "", wanted)["sessionId"]

    def _ask(self, method: str, path: str, body: object = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._session + path, data, method=method)
        with _direct.open(request, timeout=60) as answer:
            return json.load(answer)["value"]

    def open(self, url: str) -> None:
        """Load a page."""
        self._ask("POST", "/url", {"url": url})

    def run(self, script: str) -> Any:
        return self._ask("POST", "/execute/sync", {"script": script, "args": []})

    def wait_for(self, script: str, timeout_s: float = 20) -> Any:
        """Run a script until its result is truthy in JavaScript, and return the result."""
        deadline = time.monotonic() + timeout_s
        while not (result := self.run(script)):
            assert time.monotonic() < deadline, f"never true: {script}"
            time.sleep(0.05)
        return result

    def resize(self, width: int, height: int, color_scheme: str = "light") -> None:
        """Emulate a screen of a size in pixels that prefers the scheme "light" or "dark"."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._devtools("Emulation.setDeviceMetricsOverride", size)
        feature = {"name": "prefers-color-scheme", "value": color_scheme}
        self._devtools("Emulation.setEmulatedMedia", {"features": [feature]})

    @contextlib.contextmanager
    def blocked(self, *urls: str) -> Iterator[None]:
        """Load no resources at these URLs, in which ``*`` stands for any text."""
        self._devtools("Network.enable", {})
        self._devtools("Network.setBlockedURLs", {"urls": urls})
        try:
            yield
        finally:
            self._devtools("Network.setBlockedURLs", {"urls": []})

    def _devtools(self, command: str, parameters: dict[str, object]) -> None:
        self._ask("POST", "/goog/cdp/execute", {"cmd": command, "params": parameters})

    def screenshot(self) -> bytes:
        return base64.b64decode(self._ask("GET", "/screenshot"))

    @contextlib.contextmanager
    def printing(self) -> Iterator[None]:
        """Lay the page out as on A4 paper."""
        size = {"width": 718, "height": 1016, "deviceScaleFactor": 1, "mobile": False}
        self._devtools("Emulation.setDeviceMetricsOverride", size)
        self._devtools("Emulation.setEmulatedMedia", {"media": "print"})
        try:
            yield
        finally:
            self._devtools("Emulation.setEmulatedMedia", {"media": ""})

    def print_pages(self) -> int:
        """Print the page on A4; return the number of sheets."""
        pdf = base64.b64decode(self._ask("POST", "/print", {"page": {"width": 21.0, "height": 29.7}}))
        return len(re.findall(rb"/Type\s*/Page\b", pdf))

    def close(self) -> None:
        """End Chromium."""
        self._ask("DELETE", "")


@contextlib.contextmanager
def open_browser(home: Path) -> Iterator[Browser]:
    """Start a browser; without Chromium the test is skipped, or fails where ROSIDL_TEST_REQUIRE_PEERS is set."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        missing_peer("needs Debian's packages chromium and chromium-driver")
    environment = {**os.environ, "HOME": str(home)}
    driver = subprocess.Popen(["chromedriver", "--port=0"], env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert driver.stdout is not None
        port = next(found[1] for line in driver.stdout if (found := re.search(r"successfully on port (\d+)", line)))
        made = Browser(f"http://127.0.0.1:{port}", home / "profile")
        try:
            yield made
        finally:
            made.close()
    finally:
        driver.terminate()
        driver.communicate(timeout=10)


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    """A fresh Chromium."""
    with open_browser(tmp_path) as made:
        yield made
