"""The built site: it has no warnings, its search answers common questions, and its pages fit a phone."""

from __future__ import annotations

import functools
import re
import subprocess
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

import pytest
from support.browser import Browser, open_browser
from support.folders import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.needs("mkdocs", "material", "mkdocstrings_handlers.python")

QUESTIONS = [
    ("Can I pip install ROS 2 for Python?", "pip install ros2", "index"),
    ("Does it work on Windows, on a Mac?", "windows mac", "start/install"),
    ("cyclonedds does not build on a Raspberry Pi", "raspberry pi", "start/install"),
    ("No module named 'rclpy._rclpy' in conda or a venv", "rclpy conda", "start/from-rclpy"),
    ("How do I read one message?", "wait for message", "howto/publish-subscribe"),
    ("I subscribe, nothing comes, no error", "no messages", "howto/no-messages"),
    ("How do I read a best-effort sensor?", "best effort sensor", "howto/qos"),
    ("My late subscriber does not get the map (latched)", "transient local", "howto/qos"),
    ("How do I use ROS with asyncio?", "asyncio subscribe", "howto/publish-subscribe"),
    ("ROS with FastAPI or another web server", "fastapi", "howto/main-loops"),
    ("ROS in a Jupyter notebook", "jupyter", "howto/notebooks"),
    ("ROS beside Qt or another main loop", "qt", "howto/main-loops"),
    ("Calling a service in a callback hangs", "service deadlock", "howto/services"),
    ("A service call never returns", "service timeout", "howto/services"),
    ("How do I cancel an action goal?", "cancel goal", "howto/actions"),
    ("How do I set another node's parameter?", "set parameter", "howto/parameters"),
    ("Ctrl-C prints a traceback", "KeyboardInterrupt", "start/first-node"),
    ("How do I use simulated or bag time?", "use_sim_time", "howto/time"),
    ("Python nodes eat CPU while idle", "idle cpu", "reference/speed"),
    ("Custom messages without colcon", "custom message", "howto/custom-messages"),
    ("The message type '...' is invalid", "message type is invalid", "howto/messages"),
    ("Autocomplete and mypy for messages", "mypy", "howto/messages"),
    ("Decode CDR bytes without ROS", "decode cdr", "howto/messages"),
    ("Read a bag without ROS", "read bag", "start/read-a-recording"),
    ("A bag whose types I do not have", "bag unknown type", "howto/bags"),
    ("Bag to CSV, pandas, Parquet", "bag to csv", "howto/tables"),
    ("The recorder was killed, the bag does not open", "bag reindex", "howto/bags"),
    ("PointCloud2 to numpy, fast", "PointCloud2 numpy", "howto/images-clouds"),
    ("Image to OpenCV without cv_bridge", "opencv", "howto/images-clouds"),
    ("tf: extrapolation into the future", "tf extrapolation", "howto/transforms-sync"),
    ("Two cameras at the same time", "synchronize topics", "howto/transforms-sync"),
    ("Nodes in Docker or on another machine are not seen", "docker", "howto/network"),
    ("The Wi-Fi drops multicast", "multicast wifi", "howto/network"),
    ("How do I join a robot on rmw_zenoh?", "rmw_zenoh", "howto/zenoh"),
    ("Images are slow or get lost", "images lost", "howto/qos"),
    ("ros2 topic echo on a laptop without ROS", "ros2 topic echo", "commands/index"),
    ("ros2 launch without a build", "ros2 launch", "howto/launch"),
    ("Is there a demo robot, or a simulator?", "example robot", "commands/demo"),
    ("Tests of nodes are flaky", "pytest", "howto/test"),
    ("A live view without ROS on my side", "live view", "howto/live-view"),
    ("Is this instead of rosbridge, rosbags, rclpy?", "rosbridge", "background/compare"),
    ("One bag of two recorders", "merge bags", "howto/merge-bags"),
    ("Bag to video, or to image files", "bag to video", "extract images", "howto/bag-images"),
    ("The definition changed: do old bags and robots still work?", "definition changed", "howto/messages-in-a-team"),
]
"""Questions of public issues, the same in a few words, and the page that answers."""

FIRST_RESULTS = 3
_STATUS = 'document.querySelector("[data-md-component=search-result] .md-search-result__meta")'
_LINKS = 'document.querySelectorAll(".md-search-result__item > a.md-search-result__link")'
_EMPTY_HEADS = 'return [...document.querySelectorAll("article th")].filter(cell => !cell.innerText.trim()).length'
_CONTRASTS = """
const rgba = text => [...text.match(/[\\d.]+/g).map(Number), 1].slice(0, 4);
const luminance = color => color.slice(0, 3).map(part => part / 255)
    .map(part => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4)
    .reduce((sum, part, index) => sum + part * [0.2126, 0.7152, 0.0722][index], 0);
const background = element => {
    for (; element; element = element.parentElement) {
        const color = rgba(getComputedStyle(element).backgroundColor);
        if (color[3] > 0.9) return color;
    }
    return [255, 255, 255];
};
const texts = "article p, article a:not(.headerlink), article td, .md-header__title, .md-tabs__link";
return [...document.querySelectorAll(texts)]
    .filter(element => element.innerText.trim() && element.offsetParent)
    .map(element => {
        const [back, color] = [background(element), rgba(getComputedStyle(element).color)];
        const front = color.slice(0, 3).map((part, index) => part * color[3] + back[index] * (1 - color[3]));
        const [low, high] = [luminance(front), luminance(back)].sort((one, other) => one - other);
        return [element.innerText.slice(0, 40), (high + 0.05) / (low + 0.05)];
    });
"""
_OVERFLOW = "return document.documentElement.scrollWidth - window.innerWidth"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the built site."""
    folder = tmp_path_factory.mktemp("site")
    # Not --quiet: the warnings that it silences are those that --strict counts.
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


class _QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, *args: Any) -> None:
        """Print nothing."""


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """Address of the site, which this process serves."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_QuietHandler, directory=site))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with open_browser(tmp_path_factory.mktemp("browser")) as browser:
        yield browser


def pages_of(site: Path) -> list[str]:
    """Return the addresses of all pages below the site's."""
    found = (path.parent.relative_to(site).as_posix() for path in site.rglob("index.html"))
    return sorted(name.removesuffix(".") for name in found)


def search(reader: Browser, address: str, query: str) -> list[str]:
    """Type a query into the search field of the site; return the pages that it lists, the best first."""
    reader.run(f"""
        {_STATUS}.textContent = "";
        const field = document.querySelector("[data-md-component=search-query]");
        field.value = {query!r};
        field.dispatchEvent(new KeyboardEvent("keyup", {{bubbles: true}}));
    """)
    reader.wait_for(f"return {_STATUS}.textContent")
    links = reader.run(f"return [...{_LINKS}].map(link => link.href)")
    pages = [re.sub(r"[?#].*", "", link).removeprefix(address).strip("/") for link in links]
    indexes = {"": "index", "commands": "commands/index", "howto": "howto/index"}
    return list(dict.fromkeys(indexes.get(page, page) for page in pages))


def test_search_answers_common_questions(reader: Browser, address: str) -> None:
    reader.resize(1280, 800)
    reader.open(address)
    reader.run('document.querySelector("[data-md-component=search-query]").focus()')
    reader.wait_for(f'return {_STATUS}.textContent == "Type to start searching"')
    wrong = {}
    for *queries, page in QUESTIONS:
        for query in queries:
            found = search(reader, address, query)
            if page not in found[:FIRST_RESULTS]:
                wrong[query] = (page, found[: FIRST_RESULTS + 1])
    assert len(QUESTIONS) == 44
    assert not wrong, "\n".join(f"{query!r}: expected {page}, found {found}" for query, (page, found) in wrong.items())


def test_pages_fit_phones_and_name_the_columns_of_tables(reader: Browser, address: str, site: Path) -> None:
    pages = pages_of(site)
    wrong = []
    reader.resize(400, 900)
    with reader.blocked("*/search.*.js", "*/search_index.json"):  # else each page builds the index of the search
        for page in pages:
            reader.open(address + page)
            if reader.run(_OVERFLOW) > 0:
                wrong.append(f"{page} scrolls sideways")
            if reader.run(_EMPTY_HEADS):
                wrong.append(f"{page} has a table with an empty heading")
    assert len(pages) > 30 and wrong == []


@pytest.mark.parametrize("color_scheme", ["light", "dark"])
def test_texts_have_enough_contrast(reader: Browser, address: str, color_scheme: str) -> None:
    """4.5 is what WCAG 2 asks for (level AA)."""
    reader.resize(1280, 900, color_scheme)
    for page in ("", "reference/errors", "howto/services"):
        reader.open(address + page)
        assert reader.run("return matchMedia('(prefers-color-scheme: dark)').matches") == (color_scheme == "dark")
        contrasts = reader.run(_CONTRASTS)
        assert len(contrasts) > 5 and [(text, ratio) for text, ratio in contrasts if ratio < 4.5] == []
