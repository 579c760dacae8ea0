"""Policies of enclaves, and the governance and permissions of DDS Security that are made of them.

A policy states the topics, services and actions that the nodes of each enclave may use. The elements follow version
0.2.0 of the policy schema of SROS2. Elements ``xi:include`` are replaced by the included elements. An included file
must be below the folder of the policy, also after symbolic links are resolved. The number of files and of elements is
limited, because a file that includes another one twice doubles the size with each level.

Permissions are for all implementations of ROS 2 on DDS. They name DDS topics: ``rt/NAME`` is a topic;
``rq/NAMERequest`` and ``rr/NAMEReply`` are the topics of a service; an action has two topics and three services.

Source: https://design.ros2.org/articles/ros2_access_control_policies.html; DDS Security 1.1, 9.4.1;
docs/internals/protocol.md 4, 6.2, 8.1; docs/internals/keystores.md.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

from rosidl_py_gen.base.xml_reader import XmlElement
from rosidl_py_gen.errors import DefinitionError, InvalidNameError, display_path
from rosidl_py_gen.security.files import write_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from datetime import datetime

    from rosidl_py_gen.errors import Diagnostic

_MAX_INCLUDES = 1000
"""Maximum number of ``xi:include`` elements in a policy; the standard includes of a ROS node are 4 for each profile."""
_MAX_ELEMENTS = 100_000
"""Maximum number of elements of a policy after includes, which is about 2000 nodes with 50 topics each."""
_MAX_INCLUDE_DEPTH = 16
_INCLUDE = re.compile(r"\{http://www\.w3\.org/200[13]/XInclude\}(\w+)")
_XPOINTER = re.compile(r"xpointer\(\s*((?:/(?:[A-Za-z_][\w.-]*|\*))+)\s*\)")
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


def read_policy_tree(path: str) -> XmlElement:
    """Read a policy file, expand its ``xi:include`` elements, and return the root. Raises `DefinitionError`."""
    return _Includes(os.path.realpath(os.path.dirname(path) or ".")).read(path)


@dataclass(slots=True)
class _Includes:
    """Expansion of the includes of one policy; included files must be below its folder, with links resolved."""

    folder: str
    includes: int = 0
    elements: int = 0

    def read(self, path: str) -> XmlElement:
        root = XmlElement.read(path)
        self._count(root)
        if _INCLUDE.fullmatch(root.tag):
            raise root.error("the root element is an include; expected <policy> or a part of a policy")
        self._expand(root, self.folder, (os.path.realpath(path),))
        return root

    def _count(self, element: XmlElement) -> None:
        self.elements += 1
        if self.elements > _MAX_ELEMENTS:
            raise element.error(f"the policy has more than {_MAX_ELEMENTS} elements, included ones counted")
        for child in element.children:
            self._count(child)

    def _expand(self, element: XmlElement, folder: str, open_files: tuple[str, ...]) -> None:
        """Replace the include elements inside an element by the included elements.

        Each file in `open_files` includes the next one.
        """
        children: list[XmlElement] = []
        for child in element.children:
            if match := _INCLUDE.fullmatch(child.tag):
                children += self._included(child, match[1], folder, open_files)
            else:
                self._expand(child, folder, open_files)
                children.append(child)
        element.children = children

    def _included(
        self, include: XmlElement, name: str, folder: str, open_files: tuple[str, ...]
    ) -> Iterable[XmlElement]:
        if name != "include" or any(include.elements):
            raise include.error("xi:fallback is not supported: a missing file must not change permissions silently")
        self.includes += 1
        if self.includes > _MAX_INCLUDES:
            raise include.error(f"the policy has more than {_MAX_INCLUDES} includes")
        if len(open_files) > _MAX_INCLUDE_DEPTH:
            raise include.error(f"includes are nested more than {_MAX_INCLUDE_DEPTH} deep")
        unknown = sorted(include.attributes.keys() - {"href", "xpointer", "parse"})
        if unknown or include.attributes.get("parse", "xml") != "xml":
            found = unknown[0] if unknown else f"parse={include.attributes['parse']!r}"
            raise include.error(f"xi:include: got {found}; expected href, xpointer and parse='xml'")
        path = self._file(include, folder)
        if path in open_files:
            raise include.error(f"{display_path(path)} includes itself")
        pointer = include.attributes.get("xpointer")
        root = XmlElement.read(path)
        self._count(root)
        self._expand(root, os.path.dirname(path), (*open_files, path))
        return [root] if pointer is None else _select(include, pointer, root)

    def _file(self, include: XmlElement, folder: str) -> str:
        href = include.attributes.get("href", "")
        if not href or "#" in href or "?" in href or "\0" in unquote(href) or _SCHEME.match(href):
            raise include.error(
                f"xi:include: got href={href!r:.200}; expected the path of a file below the folder of the policy"
            )
        path = os.path.realpath(os.path.join(folder, unquote(href)))
        if not _is_below(path, self.folder):
            raise include.error(
                f"xi:include: {href!r:.200} is {display_path(path)}, outside the folder of the policy; move the file "
                f"below {display_path(self.folder)}"
            )
        if not os.path.isfile(path):
            raise include.error(f"xi:include: {href!r:.200} is not a file; expected one at {display_path(path)}")
        return path


def _select(include: XmlElement, pointer: str, root: XmlElement) -> list[XmlElement]:
    match = _XPOINTER.fullmatch(pointer)
    if match is None:
        raise include.error(
            f"xi:include: got xpointer={pointer!r:.200}; expected a path of names, as xpointer(/policy/enclaves/*)"
        )
    found = [XmlElement("", children=[root])]
    for name in match[1].split("/")[1:]:
        found = [child for element in found for child in element.elements if name in ("*", child.tag)]
    if not found:
        raise include.error(f"xi:include: {match[1]} is not in {root.source.path}; its root element is <{root.tag}>")
    return found


def _is_below(path: str, folder: str) -> bool:
    try:
        return os.path.commonpath([folder, path]) == folder
    except ValueError:  # on another drive
        return False


_MAX_COMMON_NAME = 64
"""Maximum number of characters of the common name in a certificate (ub-common-name, RFC 5280)."""
VERSION = "0.2.0"
ALLOW, DENY = "ALLOW", "DENY"
RULES = {
    "topics": ("topic", ("publish", "subscribe")),
    "services": ("service", ("request", "reply")),
    "actions": ("action", ("call", "execute")),
}
"""Child elements of a profile: the tag of the names in each, and the attributes that allow or deny the names."""
_MAX_DIAGNOSTICS = 20
_NAMES = frozenset(tag for tag, _ in RULES.values())
_CLARK_NAME = re.compile(r"\{([^}]*)\}(.*)", re.DOTALL)
_XML = "http://www.w3.org/XML/1998/namespace"
_IGNORED = re.compile(r"\{http://www\.w3\.org/(XML/1998/namespace|2001/XMLSchema-instance)\}\w+")
"""Regular expression for attributes that are ignored because XInclude or editors add them: ``xml:base``,
``xsi:schemaLocation``."""
_EXPRESSION = re.compile(r"(~(?=/|\Z))?[A-Za-z0-9_/*?!\[\]-]*")
"""Regular expression for a name with wildcards of fnmatch. ``~`` at the beginning is the name of the node."""
_NAMESPACE = re.compile(r"/[A-Za-z0-9_/*?!\[\]-]*")
_NODE = re.compile(r"[A-Za-z0-9_*?!\[\]-]+")


@dataclass(frozen=True, slots=True)
class PolicyRule:
    """Rule of a policy: names, and what nodes are allowed or denied to do with these names.

    Attributes:
        kind: ``topics``, ``services`` or ``actions``.
        access: `ALLOW` or `DENY` by attribute, such as ``publish``.
        names: expanded names, which begin with ``/`` and may contain wildcards.
    """

    kind: str
    access: dict[str, str]
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PolicyEnclave:
    """Rules of an enclave.

    Attributes:
        grants: for each ``<profiles>`` element, the rules of all its profiles.
        allows_everything: True if the rules come from `without_limits`.
    """

    name: str
    grants: tuple[tuple[PolicyRule, ...], ...]
    element: XmlElement
    allows_everything: bool = False

    @classmethod
    def without_limits(cls, name: str) -> PolicyEnclave:
        """Return the rules of a new enclave, which allow all topics, services and actions.

        Raises `InvalidNameError` if `name` cannot be the name of an enclave.
        """
        cls.check_name(name)
        rules = (PolicyRule(kind, dict.fromkeys(attributes, ALLOW), ("/*",)) for kind, (_, attributes) in RULES.items())
        return cls(name, (tuple(rules),), XmlElement("enclave"), allows_everything=True)

    @staticmethod
    def check_name(name: str) -> None:
        """Raise `InvalidNameError` unless rcl accepts the name of an enclave, and the name fits in a certificate.

        Valid names are, for example, ``/`` and ``/robot/talker``.
        """
        from rosidl_py_gen.runtime import validate_namespace

        try:
            validate_namespace(name)
        except InvalidNameError as error:
            text = str(error).replace("invalid namespace", "invalid enclave name", 1)
            raise InvalidNameError(text, name=name, index=error.index, reason=error.reason) from None
        if len(name) > _MAX_COMMON_NAME:
            raise InvalidNameError(
                f"invalid enclave name {name!r:.300}: it has {len(name)} characters; the common name of a certificate "
                f"has at most {_MAX_COMMON_NAME}",
                name=name,
            )


@dataclass(frozen=True, slots=True)
class SecurityPolicy:
    """Valid security policy: its tree of XML elements, and the enclaves by name that it had when it was read."""

    enclaves: dict[str, PolicyEnclave]
    root: XmlElement

    @classmethod
    def read(cls, path: str) -> SecurityPolicy:
        """Read and validate a policy file. Raises `DefinitionError` with all problems of the policy."""
        return _Validator().policy(read_policy_tree(path))

    @classmethod
    def empty(cls) -> SecurityPolicy:
        """Return a policy without enclaves, to which profiles can be added."""
        return cls({}, XmlElement("policy", {"version": VERSION}, children=[XmlElement("enclaves")]))

    def add_profile(self, enclave: str, namespace: str, node: str) -> NodeProfile:
        """Return the profile of a node in an enclave, which is created unless it exists.

        Raises `InvalidNameError` if ROS does not allow one of the names.
        """
        from rosidl_py_gen.runtime import validate_namespace, validate_node_name

        PolicyEnclave.check_name(enclave)
        validate_namespace(namespace)
        validate_node_name(node)
        parent = _child(_child(self.root, "enclaves", {}), "enclave", {"path": enclave})
        profile = _child(_child(parent, "profiles", None), "profile", {"ns": namespace, "node": node})
        return NodeProfile(profile, namespace, node)

    def write(self, path: Path) -> None:
        """Write the policy to a file, sorted and without repeated names, so that versions can be compared by line.

        The order of metadata is kept. Raises `CommandError` if the file cannot be written.
        """
        write_file(path, xml_text(self.root, is_sorted=True).encode())


@dataclass(frozen=True, slots=True)
class NodeProfile:
    """Profile of a node in a policy, to which names can be added that the node is allowed to use."""

    element: XmlElement
    namespace: str
    node: str

    def allow(self, kind: str, attribute: str, names: Iterable[str]) -> None:
        """Allow the node an access (`attribute`), such as ``publish``, to names of a `kind`, such as ``topics``."""
        rule = _child(self.element, kind, {attribute: ALLOW})
        tag, _ = RULES[kind]
        rule.children += (XmlElement(tag, text=self._relative(name)) for name in names)

    def _relative(self, name: str) -> str:
        """Return a name as programs write it: ``~/x`` below the node's name, ``x`` in its namespace, else in full."""
        prefix = "/" if self.namespace == "/" else f"{self.namespace}/"
        if name.startswith(f"{prefix}{self.node}/"):
            return f"~{name[len(prefix) + len(self.node) :]}"
        if self.namespace == "/":
            return name[1:] if name.count("/") == 1 else name
        return name.removeprefix(prefix)


def _child(parent: XmlElement, tag: str, attributes: dict[str, str] | None) -> XmlElement:
    """Return the child element with a tag and exactly these attributes (None: any), created if it does not exist.

    A rule with more attributes is not used: names added to such a rule would be allowed for more than a node does.
    """
    for child in parent.elements:
        names = {name: value for name, value in child.attributes.items() if not name.startswith("{")}
        if child.tag == tag and (attributes is None or names == attributes):
            return child
    child = XmlElement(tag, dict(attributes or {}))
    parent.children.append(child)
    return child


def expand_name(expression: str, namespace: str, node: str) -> str:
    """Expand the name of a topic, service or action in a node's profile to the full name."""
    prefix = namespace if namespace.endswith("/") else f"{namespace}/"
    if expression.startswith("/"):
        return expression
    return f"{prefix}{node}{expression[1:]}" if expression.startswith("~") else f"{prefix}{expression}"


@dataclass(slots=True)
class _Validator:
    """Validator of a policy, which reports all problems at once."""

    diagnostics: list[Diagnostic] = field(default_factory=list)

    def policy(self, root: XmlElement) -> SecurityPolicy:
        if root.tag != "policy":
            raise root.error(f"the root element is <{root.tag}>; expected <policy version='{VERSION}'>")
        self._attributes(root, "version")
        if (version := root.attributes.get("version")) not in (VERSION, None):
            self._report(root, f"policy version: got {version!r:.80}; expected {VERSION!r}")
        parents = self._children(root, "enclaves")
        if len(parents) != 1:
            self._report(root, f"<policy> has {len(parents)} <enclaves> elements; expected one")
        enclaves: dict[str, PolicyEnclave] = {}
        for parent in parents:
            self._attributes(parent)
            for element in self._children(parent, "enclave", at_least_one=True):
                enclave = self._enclave(element)
                if (first := enclaves.setdefault(enclave.name, enclave)) is not enclave:
                    where = f"{first.element.source.path}:{first.element.line}"
                    text = f"enclave {enclave.name} is also defined in {where}; put all profiles into one <enclave>"
                    self._report(element, text)
        if self.diagnostics:
            more = len(self.diagnostics) - _MAX_DIAGNOSTICS
            if more > 0:
                self.diagnostics[_MAX_DIAGNOSTICS:] = [root.diagnostic(f"{more} more problems are not shown")]
            raise DefinitionError(self.diagnostics)
        return SecurityPolicy(enclaves, root)

    def _enclave(self, element: XmlElement) -> PolicyEnclave:
        self._attributes(element, "path")
        name = element.attributes.get("path", "/")
        try:
            PolicyEnclave.check_name(name)
        except InvalidNameError as error:
            self._report(element, str(error).partition("\n")[0])
        grants = []
        for profiles in self._children(element, "profiles", at_least_one=True):
            self._attributes(profiles, optional=("type",))
            found = self._children(profiles, "profile", "metadata")
            if not any(child.tag == "profile" for child in found):
                self._report(profiles, "<profiles> is empty; expected at least one <profile>")
            rules = [rule for child in found if child.tag == "profile" for rule in self._profile(child)]
            grants.append(tuple(rules))
        return PolicyEnclave(name, tuple(grants), element)

    def _profile(self, element: XmlElement) -> Iterable[PolicyRule]:
        self._attributes(element, "ns", "node")
        namespace, node = element.attributes.get("ns", "/"), element.attributes.get("node", "_")
        if not _NAMESPACE.fullmatch(namespace):
            self._report(
                element, f"namespace of a profile: got ns={namespace!r:.200}; expected a name such as '/robot'"
            )
        if not _NODE.fullmatch(node):
            self._report(element, f"node of a profile: got node={node!r:.200}; expected a name such as 'talker'")
        for child in self._children(element, *RULES):
            tag, attributes = RULES[child.tag]
            self._attributes(child, optional=attributes)
            access = {key: child.attributes[key] for key in attributes if key in child.attributes}
            for key, value in access.items():
                if value not in (ALLOW, DENY):
                    self._report(child, f"<{child.tag}>: got {key}={value!r:.80}; expected 'ALLOW' or 'DENY'")
            if not access:
                expected = " or ".join(attributes)
                text = f"<{child.tag}> allows and denies nothing; expected {expected}"
                self._report(child, text)
            names = [self._expression(one) for one in self._children(child, tag, at_least_one=True)]
            yield PolicyRule(child.tag, access, tuple(expand_name(name, namespace, node) for name in names))

    def _expression(self, element: XmlElement) -> str:
        self._attributes(element)
        self._children(element)
        text = element.text.strip()
        if not text or not _EXPRESSION.fullmatch(text) or "//" in text:
            self._report(
                element,
                f"name of a {element.tag}: got {text!r:.200}; expected a name such as 'chatter', '/chatter' or "
                "'~/status', which may have the wildcards *, ? and [...]",
            )
        return text

    def _attributes(self, element: XmlElement, *required: str, optional: tuple[str, ...] = ()) -> None:
        for name in required:
            if name not in element.attributes:
                self._report(element, f"<{element.tag}> has no attribute {name}; expected {name}='...'")
        for name in element.attributes:
            if name not in required and name not in optional and not _IGNORED.fullmatch(name):
                expected = " or ".join((*required, *optional)) or "none"
                self._report(element, f"<{element.tag}> has the attribute {name}; expected {expected}")

    def _children(self, element: XmlElement, *tags: str, at_least_one: bool = False) -> list[XmlElement]:
        """Return the child elements with these tags, and report all other children as problems.

        Without `tags`, none is permitted.
        """
        found = []
        for child in element.elements:
            if child.tag in tags:
                found.append(child)
            else:
                expected = " or ".join(f"<{tag}>" for tag in tags) or "text"
                self._report(child, f"<{child.tag}> in <{element.tag}>; expected {expected}")
        if tags and element.text.strip():
            self._report(element, f"<{element.tag}> has the text {element.text.strip()!r:.80}; expected elements only")
        if at_least_one and not found:
            self._report(element, f"<{element.tag}> is empty; expected at least one <{tags[0]}>")
        return found

    def _report(self, element: XmlElement, text: str) -> None:
        self.diagnostics.append(element.diagnostic(text))


# --------------------------------------------------------------------------------------------------------------- text


def xml_text(root: XmlElement, *, is_sorted: bool = False) -> str:
    """Return the XML text of an element, with a line for each tag; `is_sorted` sorts children as in a policy."""
    return "\n".join(_lines(root, "", "", is_sorted=is_sorted)) + "\n"


def _lines(element: XmlElement, indent: str, default_namespace: str, *, is_sorted: bool) -> Iterable[str]:
    if element.is_comment:
        yield f"{indent}<!--{element.text}-->"
        return
    is_sorted = is_sorted and element.tag != "metadata"
    match = _CLARK_NAME.fullmatch(element.tag)
    namespace, tag = match.groups() if match else ("", element.tag)
    start = f"{indent}<{tag}"
    if namespace != default_namespace:
        start += f' xmlns="{_escape(namespace, is_attribute=True)}"'
    start += "".join(_attributes(element))
    children = _sorted(element.children) if is_sorted else element.children
    text = _escape(element.text.strip())
    if not children:
        yield f"{start}>{text}</{tag}>" if text else f"{start}/>"
        return
    yield f"{start}>{text}"
    for child in children:
        yield from _lines(child, f"{indent}  ", namespace, is_sorted=is_sorted)
    yield f"{indent}</{tag}>"


def _attributes(element: XmlElement) -> Iterable[str]:
    for number, (name, value) in enumerate(sorted(element.attributes.items())):
        if match := _CLARK_NAME.fullmatch(name):
            namespace, name = match.groups()
            if namespace == _XML:  # xml:base of an include that is expanded
                continue
            yield f' xmlns:n{number}="{_escape(namespace, is_attribute=True)}"'
            name = f"n{number}:{name}"
        yield f' {name}="{_escape(value, is_attribute=True)}"'


def _escape(text: str, *, is_attribute: bool = False) -> str:
    """Return a text with special characters escaped for XML, between tags or as an attribute in double quotes."""
    text = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    if is_attribute:
        for character, reference in (('"', "&quot;"), ("\n", "&#10;"), ("\r", "&#13;"), ("\t", "&#9;")):
            text = text.replace(character, reference)
    return text


def _sorted(children: list[XmlElement]) -> list[XmlElement]:
    """Sort the child elements of a policy as `ros2 security generate_policy` does, comments first, without repeated
    names.
    """

    def key(child: XmlElement) -> tuple[str, ...]:
        if child.is_comment:
            return ("", "", "", "")
        get = child.attributes.get
        return child.tag, child.text.strip(), get("ns", "") + get("node", ""), get("path", "")

    result: list[XmlElement] = []
    for child in sorted(children, key=key):
        is_repeated = result and child.tag in _NAMES and key(child) == key(result[-1])
        if not is_repeated:
            result.append(child)
    return result


_SCHEMA = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_{}.xsd"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_DOMAIN_RULES = {
    "allow_unauthenticated_participants": "false",
    "enable_join_access_control": "true",
    "discovery_protection_kind": "ENCRYPT",
    "liveliness_protection_kind": "ENCRYPT",
    "rtps_protection_kind": "SIGN",
}
_TOPIC_RULES = {
    "topic_expression": "*",
    "enable_discovery_protection": "true",
    "enable_liveliness_protection": "true",
    "enable_read_access_control": "true",
    "enable_write_access_control": "true",
    "metadata_protection_kind": "ENCRYPT",
    "data_protection_kind": "ENCRYPT",
}
_GRAPH_TOPIC = "ros_discovery_info"
"""DDS topic on which every participant of ROS announces its nodes."""
_ACTION_SERVICES = "cancel_goal", "get_result", "send_goal"
_ACTION_TOPICS = "feedback", "status"


def governance_xml(domain_id: int) -> str:
    """Return the governance of a keystore as XML: participants are authenticated, and everything is encrypted."""
    topic_rules = _element("topic_access_rules", _element("topic_rule", *_texts(_TOPIC_RULES)))
    rule = _element("domain_rule", _domains(domain_id), *_texts(_DOMAIN_RULES), topic_rules)
    return _document("governance", _element("domain_access_rules", rule))


def permissions_xml(enclave: PolicyEnclave, domain_id: int, not_before: datetime, not_after: datetime) -> str:
    """Return the permissions of an enclave as XML, with denials first, because the first rule that names a topic
    decides.

    The permissions are valid as long as the certificate of the enclave: from `not_before` to `not_after`, in UTC.
    """
    times = {"not_before": not_before, "not_after": not_after}
    grants = []
    for rules in enclave.grants:
        grant = _element(
            "grant",
            *_texts({"subject_name": f"CN={enclave.name}"}),
            _element("validity", *_texts({name: f"{time:%Y-%m-%dT%H:%M:%S}" for name, time in times.items()})),
            *_rule("deny_rule", domain_id, *_topics(rules, DENY)),
            *_rule("allow_rule", domain_id, *_topics(rules, ALLOW)),
            *_rule("allow_rule", domain_id, [_GRAPH_TOPIC], [_GRAPH_TOPIC]),
            *_texts({"default": "DENY"}),
        )
        grant.attributes["name"] = enclave.name
        grants.append(grant)
    return _document("permissions", _element("permissions", *grants))


def _document(schema: str, content: XmlElement) -> str:
    names = {"xmlns:xsi": _XSI, "xsi:noNamespaceSchemaLocation": _SCHEMA.format(schema)}
    return xml_text(XmlElement("dds", names, children=[content]))


def _element(tag: str, *children: XmlElement) -> XmlElement:
    return XmlElement(tag, children=[*children])


def _texts(values: Mapping[str, str]) -> list[XmlElement]:
    return [XmlElement(tag, text=text) for tag, text in values.items()]


def _domains(domain_id: int) -> XmlElement:
    return _element("domains", *_texts({"id": str(domain_id)}))


def _rule(tag: str, domain_id: int, published: list[str], subscribed: list[str]) -> list[XmlElement]:
    topics = {"publish": published, "subscribe": subscribed}
    directions = [
        _element(direction, _element("topics", *(XmlElement("topic", text=name) for name in names)))
        for direction, names in topics.items()
        if names
    ]
    return [_element(tag, _domains(domain_id), *directions)] if directions else []


def _topics(rules: Sequence[PolicyRule], qualifier: str) -> tuple[list[str], list[str]]:
    """Return the DDS topics to publish on, and the DDS topics to subscribe to, that rules allow or deny
    (`qualifier`).
    """
    published: list[list[str]] = []
    subscribed: list[list[str]] = []
    for rule in rules:
        for attribute in (name for name, value in rule.access.items() if value == qualifier):
            sent, received = _directions(rule, attribute)
            published += [sent] if sent else []
            subscribed += [received] if received else []
    return _merged(published), _merged(subscribed)


def _merged(groups: list[list[str]]) -> list[str]:
    """Return the topics of several groups without repetition; groups are sorted by their first topics, as in SROS2."""
    return [*dict.fromkeys(topic for group in sorted(groups, key=lambda one: one[0]) for topic in group)]


def _directions(rule: PolicyRule, attribute: str) -> tuple[list[str], list[str]]:
    """Return the DDS topics to publish on, and the DDS topics to subscribe to, for one attribute of a policy rule."""
    if rule.kind == "topics":
        topics = [f"rt{name}" for name in rule.names]
        return (topics, []) if attribute == "publish" else ([], topics)
    requests: list[str] = []
    replies: list[str] = []
    for name in rule.names:
        is_action = rule.kind == "actions"
        services = [f"{name}/_action/{one}" for one in _ACTION_SERVICES] if is_action else [name]
        requests += (f"rq{service}Request" for service in services)
        replies += (f"rr{service}Reply" for service in services)
        replies += (f"rt{name}/_action/{topic}" for topic in _ACTION_TOPICS if is_action)
    return (requests, replies) if attribute in ("request", "call") else (replies, requests)
