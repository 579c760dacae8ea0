"""Rules of a governance file that decide whether Cyclone DDS and Fast DDS understand each other.

The file is S/MIME with readable XML; Cyclone has verified its signature when these functions are called.

Source: docs/internals/dds.md 12.
"""

from __future__ import annotations

import re
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path

_MAX_BYTES = 1 << 20
_DOMAIN_RULE = re.compile(r"<domain_rule>(.*?)</domain_rule>", re.DOTALL)
_ID = re.compile(r"<id>\s*(\d{1,9})\s*</id>")
_RANGE = re.compile(r"<id_range>(.*?)</id_range>", re.DOTALL)
_MIN, _MAX = (re.compile(rf"<{name}>\s*(\d{{1,9}})\s*</{name}>") for name in ("min", "max"))
_TOPIC_RULE = re.compile(r"<topic_rule>(.*?)</topic_rule>", re.DOTALL)
_EXPRESSION = re.compile(r"<topic_expression>\s*(.*?)\s*</topic_expression>", re.DOTALL)
_PROTECTED_DATA = re.compile(r"<data_protection_kind>\s*(?:SIGN|ENCRYPT)\s*<")
_PLAIN_METADATA = re.compile(r"<metadata_protection_kind>\s*NONE\s*<")


class Governance:
    """Topic rules of one domain."""

    def __init__(self, folder: str, domain_id: int) -> None:
        text = ""
        with suppress(OSError), (Path(folder) / "governance.p7s").open("rb") as content:
            text = re.sub("<!--.*?-->", "", content.read(_MAX_BYTES).decode(errors="replace"), flags=re.DOTALL)
        rules = (rule for rule in _DOMAIN_RULE.findall(text) if _has_domain(rule, domain_id))
        self._rules = [
            (expression[1], bool(_PROTECTED_DATA.search(rule) and _PLAIN_METADATA.search(rule)))
            for rule in _TOPIC_RULE.findall(next(rules, ""))
            if (expression := _EXPRESSION.search(rule))
        ]
        """Expression of each rule, and True if it protects the data of a topic, but not the metadata."""

    def only_data_reason(self, topic: str = "") -> str:
        """Return why peers on Fast DDS get no data of a DDS topic, because its rule protects nothing but the data.

        Without a topic, the reason is about the first such rule. It is empty if there is none.
        """
        rules = (rule for rule in self._rules if (fnmatchcase(topic, rule[0]) if topic else rule[1]))
        expression, is_only_data = next(rules, ("", False))
        if not is_only_data:
            return ""
        return (
            f"the governance rule {expression!r:.100} protects data but not metadata, and then Cyclone DDS and Fast "
            "DDS do not understand each other; use metadata_protection_kind SIGN or ENCRYPT, or data_protection_kind "
            "NONE"
        )


def _has_domain(rule: str, domain_id: int) -> bool:
    domains = rule.partition("</domains>")[0]
    if any(int(number) == domain_id for number in _ID.findall(domains)):
        return True
    for bounds in _RANGE.findall(domains):
        low, high = _MIN.search(bounds), _MAX.search(bounds)
        if (low is None or int(low[1]) <= domain_id) and (high is None or domain_id <= int(high[1])):
            return True
    return False
