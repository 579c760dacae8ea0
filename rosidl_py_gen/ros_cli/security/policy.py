"""Policies, which state the topics, services and actions that the nodes of each enclave may use.

The elements follow version 0.2.0 of the policy schema of SROS2.
Source: https://design.ros2.org/articles/ros2_access_control_policies.html
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.base.xml_reader import COMMENT, XmlElement, escape
from rosidl_py_gen.errors import DefinitionError, InvalidNameError
from rosidl_py_gen.ros_cli.security.policy_includes import read_policy_tree

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.errors import Diagnostic

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
        allows_everything: True if the rules come from `wildcard_enclave`.
    """

    name: str
    grants: tuple[tuple[PolicyRule, ...], ...]
    element: XmlElement
    allows_everything: bool = False


@dataclass(frozen=True, slots=True)
class SecurityPolicy:
    """Valid security policy: its enclaves by name, and its tree of XML elements."""

    enclaves: dict[str, PolicyEnclave]
    root: XmlElement


def check_enclave_name(name: str) -> None:
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
            f"invalid enclave name {name!r:.300}: it has {len(name)} characters; the common name of a certificate has "
            f"at most {_MAX_COMMON_NAME}",
            name=name,
        )


def read_policy(path: str) -> SecurityPolicy:
    """Read and validate a policy file. Raises `DefinitionError` with all problems of the policy."""
    root = read_policy_tree(path)
    return _Validator().policy(root)


def wildcard_enclave(name: str) -> PolicyEnclave:
    """Return the rules of a new enclave, which allow all topics, services and actions."""
    rules = (PolicyRule(kind, dict.fromkeys(attributes, ALLOW), ("/*",)) for kind, (_, attributes) in RULES.items())
    return PolicyEnclave(name, (tuple(rules),), XmlElement("enclave"), allows_everything=True)


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
            check_enclave_name(name)
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


def policy_text(root: XmlElement) -> str:
    """Return the XML of a policy, sorted and without repeated names, so that versions can be compared line by line.

    The order of metadata is kept.
    """
    return xml_text(root, is_sorted=True)


def xml_text(root: XmlElement, *, is_sorted: bool = False) -> str:
    """Return the XML text of an element, with a line for each tag; `is_sorted` sorts children as in a policy."""
    return "\n".join(_lines(root, "", "", is_sorted=is_sorted)) + "\n"


def _lines(element: XmlElement, indent: str, default_namespace: str, *, is_sorted: bool) -> Iterable[str]:
    if element.tag == COMMENT:
        yield f"{indent}<!--{element.text}-->"
        return
    is_sorted = is_sorted and element.tag != "metadata"
    match = _CLARK_NAME.fullmatch(element.tag)
    namespace, tag = match.groups() if match else ("", element.tag)
    start = f"{indent}<{tag}"
    if namespace != default_namespace:
        start += f' xmlns="{escape(namespace, is_attribute=True)}"'
    start += "".join(_attributes(element))
    children = _sorted(element.children) if is_sorted else element.children
    text = escape(element.text.strip())
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
            yield f' xmlns:n{number}="{escape(namespace, is_attribute=True)}"'
            name = f"n{number}:{name}"
        yield f' {name}="{escape(value, is_attribute=True)}"'


def _sorted(children: list[XmlElement]) -> list[XmlElement]:
    """Sort the child elements of a policy as `ros2 security generate_policy` does, comments first, without repeated
    names.
    """

    def key(child: XmlElement) -> tuple[str, ...]:
        if child.tag == COMMENT:
            return ("", "", "", "")
        get = child.attributes.get
        return child.tag, child.text.strip(), get("ns", "") + get("node", ""), get("path", "")

    result: list[XmlElement] = []
    for child in sorted(children, key=key):
        is_repeated = result and child.tag in _NAMES and key(child) == key(result[-1])
        if not is_repeated:
            result.append(child)
    return result
