"""The built site: it has no warnings, its search answers common questions, and its pages fit a phone."""

from __future__ import annotations

import functools
import os
import re
import subprocess
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

import pytest
from support.browser import Browser, open_browser
from support.folders import ROOT

from rosidl_py_gen import __version__

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

REPORTED_QUESTIONS = [
    ("No module named 'sensor_msgs'", "start/install howto/messages reference/errors howto/custom-messages"),
    (
        "ModuleNotFoundError: No module named 'std_msgs'",
        "start/install howto/messages reference/errors howto/publish-subscribe howto/custom-messages",
    ),
    (
        "remap topic name from command line",
        "reference/settings start/from-rclpy howto/no-messages index howto/several-robots start/rclpy-names",
    ),
    ("node namespace multiple robots", "howto/network reference/settings howto/several-robots"),
    ("publish at a fixed rate", "howto/time"),
    ("publish Twist cmd_vel python", "commands/topic-service-action howto/publish-subscribe commands/demo"),
    ("record a bag from python", "howto/bags"),
    ("convert db3 to mcap", "commands/bag howto/bags"),
    ("merge two bags", "commands/bag howto/bags howto/merge-bags"),
    ("play bag slower", "commands/bag"),
    ("filter bag by topic and time range", "commands/bag howto/bags"),
    ("extract images from rosbag as png", "howto/images-clouds howto/bags commands/bag howto/bag-images"),
    ("numpy array to sensor_msgs Image", "howto/images-clouds"),
    ("static transform publisher python", "howto/transforms-sync"),
    ("euler to quaternion", "howto/rotations howto/transforms-sync start/from-rclpy"),
    ("MultiThreadedExecutor deadlock", "start/from-rclpy howto/services start/rclpy-names"),
    ("This event loop is already running", "howto/notebooks reference/errors"),
    ("set logger level", "howto/logging-lifecycle"),
    ("load parameters from yaml file", "howto/parameters commands/node-param-lifecycle reference/settings"),
    ("parameter callback when value changes", "howto/parameters"),
    ("ROS_LOCALHOST_ONLY", "reference/settings howto/network"),
    ("Fast DDS discovery server", "howto/network reference/compatibility"),
    ("shared memory zero copy", "reference/compatibility howto/network reference/speed howto/zenoh"),
    ("WSL2", "start/install howto/network reference/compatibility howto/launch"),
    ("ApproximateTimeSynchronizer", "howto/transforms-sync"),
    ("wait for service to become available", "howto/services"),
    ("action goal preempt new goal", "howto/actions"),
    ("activate lifecycle node from python", "howto/logging-lifecycle commands/node-param-lifecycle"),
    ("urdf robot_state_publisher", "howto/transforms-sync howto/launch"),
    (
        "RIHS01 type hash mismatch",
        "howto/no-messages reference/errors reference/compatibility howto/messages howto/custom-messages",
    ),
    ("rosbridge websocket javascript", "background/compare howto/live-view"),
    ("tab completion bash zsh", "commands/index"),
    ("rqt_graph", "commands/diagnose"),
    ("rqt_plot live plot", "commands/topic-service-action"),
    ("echo only one field of a message", "commands/topic-service-action"),
    ("ros1 bag", "howto/bags reference/compatibility background/compare"),
    ("point cloud to open3d pcd", "howto/images-clouds"),
    ("message to json", "howto/messages howto/custom-messages"),
    ("unit test a subscriber callback", "howto/test"),
    ("benchmark latency compared with rclpy", "reference/speed background/compare"),
]
"""Questions of users as typed, and the pages that answer them."""

OTHER_QUESTIONS = [
    ("how do I read a topic from a thread", "howto/scripts"),
    ("which nodes are running", "commands/node-param-lifecycle commands/diagnose"),
    ("how often is a topic published", "commands/topic-service-action"),
    ("can I install it with uv", "start/install"),
    ("run my rclpy node without installing ROS", "start/from-rclpy start/rclpy-names"),
    ("subscriber gets nothing because the QoS is incompatible", "howto/qos howto/no-messages"),
    ("show the robot's camera in a browser", "howto/live-view howto/images-clouds"),
    ("write a service server", "howto/services"),
    ("wait until a transform is available", "howto/transforms-sync"),
    ("how to stop a running action", "howto/actions"),
    ("save all parameters of a node to a file", "commands/node-param-lifecycle howto/parameters"),
    ("run tests faster than real time", "howto/test howto/time"),
    ("lidar points as a numpy array", "howto/images-clouds"),
    ("create my own message type", "howto/messages howto/custom-messages"),
    ("does it work with a robot on Humble", "reference/compatibility howto/no-messages index howto/zenoh"),
    ("robot behind NAT or a mobile network", "howto/zenoh"),
    ("encrypt the traffic between nodes", "howto/security"),
    ("export odometry to excel", "howto/tables"),
    ("two robots with the same topic names", "howto/several-robots"),
    ("what replaces each ros2 command", "reference/cheat-sheet commands/index"),
]
"""The same, written before their results were known."""

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
_REPOSITORY = "https://git.example/robots/rosidl-py-gen"
"""Address that the workflow `docs.yml` would give."""
_OVERFLOW = "return document.documentElement.scrollWidth - window.innerWidth"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the built site."""
    folder = tmp_path_factory.mktemp("site")
    # Not --quiet: the warnings that it silences are those that --strict counts.
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"REPOSITORY_URL": _REPOSITORY}, capture_output=True, text=True
    )
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


@pytest.fixture
def searching(reader: Browser, address: str) -> Browser:
    """The browser with the search of the site open."""
    reader.resize(1280, 800)
    reader.open(address)
    reader.run('document.querySelector("[data-md-component=search-query]").focus()')
    reader.wait_for(f'return {_STATUS}.textContent == "Type to start searching"')
    return reader


def test_search_answers_common_questions(searching: Browser, address: str) -> None:
    wrong = {}
    for *queries, page in QUESTIONS:
        for query in queries:
            found = search(searching, address, query)
            if page not in found[:FIRST_RESULTS]:
                wrong[query] = (page, found[: FIRST_RESULTS + 1])
    assert len(QUESTIONS) == 44
    assert not wrong, "\n".join(f"{query!r}: expected {page}, found {found}" for query, (page, found) in wrong.items())


@pytest.mark.parametrize(("questions", "count", "min_hits"), [(REPORTED_QUESTIONS, 40, 38), (OTHER_QUESTIONS, 20, 19)])
def test_search_answers_questions_in_natural_words(
    searching: Browser, address: str, site: Path, questions: list[tuple[str, str]], count: int, min_hits: int
) -> None:
    existing = {"index", "commands/index", *pages_of(site)}
    assert {page for _, pages in questions for page in pages.split()} - existing == set()
    found = {question: search(searching, address, question)[: FIRST_RESULTS + 1] for question, _ in questions}
    missed = [
        (query, found[query]) for query, pages in questions if not {*pages.split()} & {*found[query][:FIRST_RESULTS]}
    ]
    assert len(found) == count and count - len(missed) >= min_hits, missed


@pytest.mark.parametrize(
    ("typed", "equal"),
    [
        ("How do I merge the bags of two recorders?", "merge bag two recorders"),
        ("publish in ROS 2 with Python at a fixed rate", "publish fixed rate"),
        ("robots stopping", "robot stop"),
        ("'sensor_msgs'", "sensor_msgs"),
    ],
)
def test_search_ignores_stop_words_and_endings(searching: Browser, address: str, typed: str, equal: str) -> None:
    assert search(searching, address, typed) == search(searching, address, equal) != []


def test_search_keeps_operators(searching: Browser, address: str) -> None:
    assert len(search(searching, address, "+zenoh +parquet")) < len(search(searching, address, "zenoh parquet"))


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


def test_cheat_sheet_is_printed_on_two_sheets_without_cut_columns(reader: Browser, address: str) -> None:
    reader.resize(1280, 900)
    reader.open(address + "reference/cheat-sheet")
    assert reader.print_pages() <= 2
    with reader.printing():
        wide = "document.querySelectorAll('.cheat-sheet .md-typeset__table')"
        assert reader.run(f"return [...{wide}].every(table => table.scrollWidth <= table.clientWidth + 1)")


def test_header_links_to_the_repository(reader: Browser, address: str) -> None:
    reader.open(address)
    assert _REPOSITORY in reader.run("return [...document.querySelectorAll('.md-header a')].map((link) => link.href)")


def test_footer_shows_version_and_licence(reader: Browser, address: str) -> None:
    reader.open(address + "howto/services")
    assert f"rosidl-py-gen {__version__} · licence Apache-2.0" in reader.run(
        "return document.querySelector('.md-copyright').innerText"
    )


@pytest.mark.parametrize("color_scheme", ["light", "dark"])
def test_texts_have_enough_contrast(reader: Browser, address: str, color_scheme: str) -> None:
    """4.5 is what WCAG 2 asks for (level AA)."""
    reader.resize(1280, 900, color_scheme)
    for page in ("", "reference/errors", "howto/services"):
        reader.open(address + page)
        assert reader.run("return matchMedia('(prefers-color-scheme: dark)').matches") == (color_scheme == "dark")
        contrasts = reader.run(_CONTRASTS)
        assert len(contrasts) > 5 and [(text, ratio) for text, ratio in contrasts if ratio < 4.5] == []
