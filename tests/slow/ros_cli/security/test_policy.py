"""Invalid and malicious policies, and generated policies compared with policies of SROS2."""

from __future__ import annotations

import json
import os
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.action import Fibonacci
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import String
from std_srvs.srv import Trigger
from support.inner_state import scope_of

from rosidl_py_gen.base.xml_reader import XmlElement
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.runtime import Context
from rosidl_py_gen.security.policy import ALLOW, PolicyEnclave, PolicyRule, SecurityPolicy, permissions_xml

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.commands import Tool
    from support.worlds import World

    Run = Callable[..., str]


XI = 'xmlns:xi="http://www.w3.org/2001/XInclude"'
POLICY = f"""<policy version="0.2.0" {XI}><enclaves>
<enclave path="/a"><profiles>
<profile ns="/" node="n">
%s
</profile></profiles></enclave></enclaves></policy>"""
GOOD = '<topics publish="ALLOW"><topic>t</topic></topics>'


def problems(path: Path, text: str | bytes) -> list[str]:
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(DefinitionError) as caught:
        SecurityPolicy.read(str(path))
    for one in caught.value.diagnostics:
        assert one.path.endswith(".xml"), one
    return [f"{Path(one.path).name}:{one.line}: {one.text}" for one in caught.value.diagnostics]


def policy(content: str) -> str:
    return POLICY % content


def test_valid_policy_is_read(tmp_path: Path) -> None:
    (tmp_path / "p.xml").write_text(policy(GOOD))
    assert SecurityPolicy.read(str(tmp_path / "p.xml")).enclaves["/a"].grants[0][0].names == ("/t",)


WRONG = {
    "": "p.xml:1: not XML: no element found",
    "no xml": "p.xml:1: not XML: syntax error",
    "<policy version='0.2.0'>\n<enclaves></policy>": "p.xml:2: not XML: mismatched tag",
    "<policies/>": "p.xml:1: the root element is <policies>; expected <policy version='0.2.0'>",
    **{
        f"<policy {version}>{policy(GOOD).partition('>')[2]}": f"p.xml:1: {problem}"
        for version, problem in (
            ("version='0.1.0'", "policy version: got '0.1.0'; expected '0.2.0'"),
            ("", "<policy> has no attribute version; expected version='...'"),
        )
    },
    "<policy version='0.2.0'/>": "p.xml:1: <policy> has 0 <enclaves> elements; expected one",
    **{
        f"<policy version='0.2.0'><enclaves><enclave path='{name}'><profiles/></enclave></enclaves></policy>": (
            f"p.xml:1: {problem}"
        )
        for name, problem in (
            ("a", "invalid enclave name 'a': it must begin with '/'"),
            (
                "/../x",
                "invalid enclave name '/../x': character '.' is not allowed, only A-Z, a-z, 0-9, _ and / are",
            ),
            ("/a", "<profiles> is empty; expected at least one <profile>"),
        )
    },
    **{
        policy(content): f"p.xml:{problem}"
        for content, problem in (
            ("<topic>t</topic>", "4: <topic> in <profile>; expected <topics> or <services> or <actions>"),
            (
                '<topics publish="allow"><topic>t</topic></topics>',
                "4: <topics>: got publish='allow'; expected 'ALLOW' or 'DENY'",
            ),
            (
                "<topics><topic>t</topic></topics>",
                "4: <topics> allows and denies nothing; expected publish or subscribe",
            ),
            (
                '<topics request="ALLOW" publish="ALLOW"><topic>t</topic></topics>',
                "4: <topics> has the attribute request; expected publish or subscribe",
            ),
            ('<topics publish="ALLOW"/>', "4: <topics> is empty; expected at least one <topic>"),
            (
                '<topics publish="ALLOW">\n<topic>a b</topic></topics>',
                "5: name of a topic: got 'a b'; expected a name such as 'chatter', '/chatter' or '~/status', which may "
                "have the wildcards *, ? and [...]",
            ),
            ('<services reply="ALLOW"><topic>t</topic></services>', "4: <topic> in <services>; expected <service>"),
            (f"{GOOD} stray", "3: <profile> has the text 'stray'; expected elements only"),
            ('<topics publish="ALLOW"><topic>t<b/></topic></topics>', "4: <b> in <topic>; expected text"),
            ('<x:topics xmlns:x="urn:x"/>', "4: <{urn:x}topics> in <profile>; expected <topics> or <services> or"),
        )
    },
    **{
        policy(f'<topics publish="ALLOW"><topic>{name}</topic></topics>'): "p.xml:4: name of a topic: got "
        for name in (
            "",
            " ",
            "//a",
            "a//b",
            "~a",
            "a~",
            "{node}",
            "a\nb",
            "a&amp;b",
            "&lt;x&gt;",
            "\u00e9",
            "..",
            "a.b",
        )
    },
    **{
        policy(GOOD).replace('ns="/" node="n"', f'ns="{ns}" node="{node}"'): " of a profile: got "
        for ns, node in (("a", "n"), ("/", "a/b"), ("/", ""), ("/ ", "n"), ("/", "n&#10;"), ("/&quot;", "n"))
    },
    **{
        f"<?xml version='1.0' encoding='{encoding}'?>{policy(GOOD)}": "not XML"
        for encoding in ("utf-7", "rot13", "hex", "unknown-1", "utf-32")
    },
}


@pytest.mark.parametrize("text", WRONG)
def test_invalid_policies_are_reported_with_line(tmp_path: Path, text: str) -> None:
    found = problems(tmp_path / "p.xml", text)
    assert any(WRONG[text] in one for one in found) and not any("\n" in one for one in found), found


def test_duplicate_enclave_is_reported_with_both_lines(tmp_path: Path) -> None:
    text = policy(GOOD)
    enclave = text[text.index("<enclave ") : text.index("</enclaves>")]
    found = problems(tmp_path / "p.xml", text.replace("</enclaves>", f"\n{enclave}</enclaves>"))
    assert [one.partition(": ")[0] for one in found] == ["p.xml:6"]
    assert "enclave /a is also defined in " in found[0] and "p.xml:2; put all profiles into one <enclave>" in found[0]


def test_all_problems_are_reported_up_to_a_limit(tmp_path: Path) -> None:
    found = problems(tmp_path / "p.xml", policy("<x/>\n" * 100))
    assert len(found) == 21 and found[-1].endswith(": 80 more problems are not shown")


def test_create_permission_shows_invalid_line_of_policy(tmp_path: Path, keystore: Path, fail: Run) -> None:
    path = tmp_path / "p.xml"
    path.write_text(policy('  <topics publish="YES"><topic>t</topic></topics>'))
    error = fail("create_permission", str(keystore), "/a", str(path))
    assert error.endswith(
        "p.xml:4:3: <topics>: got publish='YES'; expected 'ALLOW' or 'DENY'\n"
        '      <topics publish="YES"><topic>t</topic></topics>\n      ^\n'
    )


# -------------------------------------------------------------------------------------------------------------- hostile


@pytest.mark.parametrize(
    "head",
    [
        '<!DOCTYPE policy [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>',
        '<!DOCTYPE policy SYSTEM "policy.dtd">',
        '<!DOCTYPE policy [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE policy [<!ENTITY % x SYSTEM "http://127.0.0.1/x"> %x;]>',
        "<!DOCTYPE policy>",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_document_types_and_entities_are_refused(tmp_path: Path, head: str, encoding: str) -> None:
    text = f"<?xml version='1.0' encoding='{encoding}'?>\n{head}\n{policy(GOOD)}"
    expected = "p.xml:2: document types and entities are refused; remove the <!DOCTYPE ...>"
    assert problems(tmp_path / "p.xml", text.encode(encoding)) == [expected]


def test_policy_file_size_is_limited(tmp_path: Path) -> None:
    (found,) = problems(tmp_path / "p.xml", policy(f"<!--{'x' * 2**20}-->"))
    assert found == f"p.xml:0: more than {2**20} bytes; split the file by includes"


def include(href: str, pointer: str = "/profile/*", **more: str) -> str:
    xpointer = f' xpointer="xpointer({pointer})"' if pointer else ""
    return f'<xi:include href="{href}"{xpointer}{"".join(f" {name}={value!r}" for name, value in more.items())}/>'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder of policies, next to a profile that its policies must not include."""
    made = tmp_path / "policies"
    (made / "sub").mkdir(parents=True)
    for path in (tmp_path / "outside.xml", made / "inside.xml", made / "sub/deep.xml"):
        path.write_text(f"<profile>{GOOD}</profile>")
    (tmp_path / "policies-too").mkdir()
    (tmp_path / "policies-too/x.xml").write_text(f"<profile>{GOOD}</profile>")
    return made


@pytest.mark.parametrize("href", ["inside.xml", "sub/deep.xml", "./sub/../inside.xml", "in%73ide.xml"])
def test_files_below_policy_folder_can_be_included(folder: Path, href: str) -> None:
    (folder / "p.xml").write_text(policy(include(href)))
    assert SecurityPolicy.read(str(folder / "p.xml")).enclaves["/a"].grants[0][0].names == ("/t",)


PATHS = "expected the path of a file below the folder of the policy"
BAD_INCLUDES = {
    **dict.fromkeys(
        [
            *("../outside.xml", "sub/../../outside.xml", "%2e%2e/outside.xml"),
            *("/etc/passwd", "//etc/passwd", "../policies-too/x.xml"),
        ],
        "outside the folder of the policy; move the file",
    ),
    **dict.fromkeys(["", "file:///etc/passwd", "http://127.0.0.1/x.xml", "inside.xml#x"], PATHS),
    **dict.fromkeys(["inside.xml?x", "a%00b", "C:\\x.xml"], PATHS),
}


@pytest.mark.parametrize("href", BAD_INCLUDES)
def test_includes_outside_policy_folder_are_refused(folder: Path, href: str) -> None:
    (found,) = problems(folder / "p.xml", policy(include(href)))
    assert found.startswith("p.xml:4: xi:include: ") and BAD_INCLUDES[href] in found


@pytest.mark.skipif(os.name == "nt", reason="symbolic links of POSIX")
def test_includes_through_links_leaving_the_folder_are_refused(folder: Path) -> None:
    (folder / "link.xml").symlink_to("../outside.xml")
    (folder / "up").symlink_to("..")
    (folder / "inner.xml").symlink_to("sub/deep.xml")
    (folder / "loop.xml").symlink_to("loop.xml")
    for href in ("link.xml", "up/outside.xml"):
        (found,) = problems(folder / "p.xml", policy(include(href)))
        assert "outside the folder of the policy" in found
    (found,) = problems(folder / "p.xml", policy(include("loop.xml")))
    assert "is not a file" in found
    (folder / "p.xml").write_text(policy(include("inner.xml")))
    SecurityPolicy.read(str(folder / "p.xml"))


def test_includes_are_relative_to_folder_of_link_not_of_its_target(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "real.xml").write_text(policy(include("inside.xml")))
    (folder / "link.xml").symlink_to("../real.xml")
    with pytest.raises(DefinitionError, match=r"real\.xml|link\.xml") as caught:
        SecurityPolicy.read(str(tmp_path / "real.xml"))
    assert "is not a file" in str(caught.value)
    SecurityPolicy.read(str(folder / "link.xml"))


def test_invalid_includes_are_reported(folder: Path) -> None:
    for content, expected in (
        (include("none.xml"), "xi:include: 'none.xml' is not a file; expected one at "),
        (include("sub"), "xi:include: 'sub' is not a file"),
        (include("inside.xml", parse="text"), "xi:include: got parse='text'; expected href, xpointer and parse='xml'"),
        (include("inside.xml", encoding="x"), "xi:include: got encoding; expected href, xpointer and parse='xml'"),
        (include("inside.xml", "/policy/*"), "xi:include: /policy/* is not in "),
        (include("inside.xml", "//*"), "expected a path of names, as xpointer(/policy/enclaves/*)"),
        (include("inside.xml", "id('x')"), "expected a path of names"),
        (include("inside.xml", ""), "<profile> in <profile>; expected <topics> or <services> or <actions>"),
        (
            '<xi:include href="none.xml"><xi:fallback/></xi:include>',
            "xi:fallback is not supported: a missing file must not change permissions silently",
        ),
    ):
        assert any(expected in one for one in problems(folder / "p.xml", policy(content))), expected


def test_error_in_included_file_is_reported_with_its_file_and_line(folder: Path) -> None:
    (folder / "sub/wrong.xml").write_text("<profile>\n\n<topics publish='x'><topic>t</topic></topics></profile>")
    assert problems(folder / "p.xml", policy(include("sub/wrong.xml"))) == [
        "wrong.xml:3: <topics>: got publish='x'; expected 'ALLOW' or 'DENY'"
    ]


def test_circular_includes_are_reported(folder: Path) -> None:
    (folder / "a.xml").write_text(f"<profile {XI}>{include('b.xml')}</profile>")
    (folder / "b.xml").write_text(f"<profile {XI}>\n{include('a.xml')}</profile>")
    (found,) = problems(folder / "p.xml", policy(include("a.xml")))
    assert found.startswith("b.xml:2: ") and "a.xml includes itself" in found


def test_include_without_xpointer_inserts_whole_file(folder: Path) -> None:
    (folder / "profile.xml").write_text(f"<profile ns='/' node='other'>{GOOD}</profile>")
    text = policy(GOOD).replace("</profiles>", f"{include('profile.xml', '')}</profiles>")
    (folder / "p.xml").write_text(text)
    assert len(SecurityPolicy.read(str(folder / "p.xml")).enclaves["/a"].grants[0]) == 2


def test_doubling_includes_are_limited(folder: Path) -> None:
    """Each file includes the next one ten times: a billion elements."""
    for number in range(9):
        more = include(f"{number + 1}.xml") * 10
        (folder / f"{number}.xml").write_text(f"<profile {XI}>{more}</profile>")
    (folder / "9.xml").write_text(f"<profile>{GOOD * 10}</profile>")
    (found,) = problems(folder / "p.xml", policy(include("0.xml")))
    assert found.endswith("the policy has more than 1000 includes")


def test_large_includes_are_limited(folder: Path) -> None:
    (folder / "inside.xml").write_text(f"<profile>{GOOD * 10_000}</profile>")
    (found,) = problems(folder / "p.xml", policy(include("inside.xml") * 20))
    assert "the policy has more than 100000 elements, included ones counted" in found


def test_deep_chains_of_includes_are_limited(folder: Path) -> None:
    for number in range(40):
        (folder / f"{number}.xml").write_text(f"<profile {XI}>{include(f'{number + 1}.xml')}</profile>")
    (found,) = problems(folder / "p.xml", policy(include("0.xml")))
    assert found.endswith("includes are nested more than 16 deep")


@given(st.binary(max_size=200), st.booleans())
def test_arbitrary_bytes_are_read_or_reported_as_invalid(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, inside: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.xml"
    path.write_bytes(policy(GOOD).encode().replace(b">t<", b">" + data + b"<") if inside else data)
    try:
        SecurityPolicy.read(str(path))
    except DefinitionError as error:
        assert "expected" in str(error) or "not XML" in str(error) or "refused" in str(error)


QUIET: Any = dict.fromkeys(("start_services", "enable_rosout", "parameter_events"), False)
QUIET["parameter_overrides"] = {"start_type_description_service": False}


@pytest.fixture
def graph(memory: World, golden: Path) -> None:
    """The nodes of graph.json."""
    contexts: dict[str, Context] = {}
    for one in json.loads((golden / "graph.json").read_text()):
        enclave = one["enclave"]
        if enclave not in contexts:
            contexts[enclave] = memory.context(f"--ros-args --enclave {enclave}")
        node = memory.node(one["name"], one["namespace"], context=contexts[enclave], **QUIET)
        for name in one["publishers"]:
            node.create_publisher(String, name)
        for name in one["subscribers"]:
            node.create_subscription(String, name)
        for name in one["services"]:
            node.create_service(Trigger, name)
        for name in one["clients"]:
            node.create_client(Trigger, name)


async def test_generated_policy_equals_policy_of_sros2(graph: None, tool: Tool, golden: Path, tmp_path: Path) -> None:
    path = tmp_path / "policy.xml"
    ended = await tool("security", "generate_policy", str(path))
    assert (ended.code, ended.err) == (0, "")
    assert ended.out == f"wrote {path}: 3 nodes, enclaves /demo/listener, /demo/talker\n"
    assert path.read_text() == (golden / "policy.xml").read_text()


async def test_generate_policy_extends_existing_policy(graph: None, tool: Tool, golden: Path, tmp_path: Path) -> None:
    path = tmp_path / "policy.xml"
    path.write_text((golden / "policies/two_grants.xml").read_text())
    ended = await tool("security", "generate_policy", str(path), "--json")
    assert [one["name"] for one in json.loads(ended.out)["nodes"]] == ["/talker", "/left/listener", "/left/second"]
    assert path.read_text() == (golden / "extended.xml").read_text()
    before = path.read_text()
    await tool("security", "generate_policy", str(path))
    assert path.read_text() == before


async def test_generate_policy_adds_no_names_to_rules_that_allow_more(graph: None, tool: Tool, tmp_path: Path) -> None:
    """SROS2 adds topics to the first rule that allows subscriptions, though it may allow publishing, too."""
    path = tmp_path / "policy.xml"
    path.write_text(
        '<policy version="0.2.0"><enclaves><!-- a note --><enclave path="/demo/talker"><profiles>'
        '<profile ns="/" node="talker"><topics publish="ALLOW" subscribe="ALLOW"><topic>both</topic></topics></profile>'
        '<metadata x="1"><b xmlns="urn:b" y="&lt;"/>text</metadata></profiles></enclave></enclaves></policy>'
    )
    await tool("security", "generate_policy", str(path))
    rules = SecurityPolicy.read(str(path)).enclaves["/demo/talker"].grants[0]
    found = {tuple(sorted(rule.access)): set(rule.names) for rule in rules if rule.kind == "topics"}
    assert found == {
        ("publish", "subscribe"): {"/both"},
        ("subscribe",): {"/clock"},
        ("publish",): {"/chatter", "/deep/topic", "/talker/status"},
    }
    text = path.read_text()
    assert "<!-- a note -->" in text and '<b xmlns="urn:b" y="&lt;"/>' in text and '<metadata x="1">text' in text


async def test_generate_policy_without_nodes_fails_and_writes_no_file(
    memory: World, tool: Tool, tmp_path: Path
) -> None:
    memory.node("_hidden")
    ended = await tool("security", "generate_policy", str(tmp_path / "policy.xml"))
    assert (ended.code, ended.out) == (1, "")
    assert "no nodes were found in domain 0; " in ended.err and "was not written" in ended.err
    assert not [*tmp_path.iterdir()]


async def test_generate_policy_does_not_overwrite_other_files(graph: None, tool: Tool, tmp_path: Path) -> None:
    path = tmp_path / "policy.xml"
    path.write_text("<other/>")
    ended = await tool("security", "generate_policy", str(path))
    assert ended.code == 1 and "the root element is <other>; expected <policy" in ended.err
    assert path.read_text() == "<other/>"


async def test_generate_policy_writes_through_symbolic_link(graph: None, tool: Tool, tmp_path: Path) -> None:
    (tmp_path / "link.xml").symlink_to("policy.xml")
    await tool("security", "generate_policy", str(tmp_path / "link.xml"))
    assert (tmp_path / "link.xml").is_symlink()
    assert set(SecurityPolicy.read(str(tmp_path / "policy.xml")).enclaves) == {"/demo/talker", "/demo/listener"}


async def test_generate_policy_skips_nodes_with_invalid_names(memory: World, tool: Tool, tmp_path: Path) -> None:
    discovery = scope_of(memory.node("good", **QUIET)).discovery
    for namespace, name in (("/a\"><enclave path='/x", "n"), ("/n", 'b"/>\n<x'), ("/", "")):
        discovery.add_node(name, namespace)
    path = tmp_path / "policy.xml"
    ended = await tool("security", "generate_policy", str(path))
    assert ended.code == 0
    assert ended.err.count("skipped node ") == ended.err.count("\n") > 0
    assert [*SecurityPolicy.read(str(path)).enclaves] == ["/"]
    assert path.read_text().count("<profile ") == 1


async def test_generated_policy_allows_actions_by_their_topics_and_services(
    memory: World, tool: Tool, tmp_path: Path
) -> None:
    """The permissions are those of an ``<actions>`` element."""
    server, client = memory.node("server", **QUIET), memory.node("client", **QUIET)
    server.create_action_server(Fibonacci, "count", lambda goal: None)
    client.create_action_client(Fibonacci, "count")
    path = tmp_path / "policy.xml"
    assert (await tool("security", "generate_policy", str(path))).code == 0
    (rules,) = SecurityPolicy.read(str(path)).enclaves["/"].grants
    for node, attribute in (("server", "execute"), ("client", "call")):
        made = tuple(
            rule for rule in rules if ("reply" in rule.access or "publish" in rule.access) == (node == "server")
        )
        expected = (PolicyRule("actions", {attribute: ALLOW}, ("/count",)),)
        assert allowed(made) == allowed(expected)


def allowed(rules: tuple[PolicyRule, ...]) -> list[str]:
    enclave = PolicyEnclave("/", (rules,), XmlElement("enclave"))
    return sorted(permissions_xml(enclave, 0, datetime(2020, 1, 1), datetime(2030, 1, 1)).splitlines())
