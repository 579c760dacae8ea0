"""Access control and rate limit of the live view.

A browser states the page that connects in the Origin header, which a page cannot change. Other programs may omit or
forge it; a token keeps them out.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from collections.abc import Sequence

KNOWN_ORIGINS = ("https://app.foxglove.dev", "https://lichtblick-suite.github.io", "file://")
"""Origins of Foxglove, Lichtblick and desktop apps. Pages from files, or that hide their origin, send ``null``."""
_LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
ANY = "*"


@dataclass(frozen=True, slots=True)
class Access:
    """Access rules.

    Attributes:
        origins: permitted pages in addition to the known ones, such as ``https://example.org``; `ANY` permits all.
        token: required value of ``?token=...`` in the address; empty for none.
    """

    origins: Sequence[str] = ()
    token: str = ""

    def refusal(self, origins: Sequence[str], path: str) -> tuple[int, str] | None:
        """Return status and text of an HTTP response that refuses a connection; None if it is permitted.

        Args:
            origins: all Origin headers of the request.
            path: requested path with the query.
        """
        if len(origins) > 1 or not all(map(self._is_allowed, origins)):
            text = ", ".join(origins)[:100]
            return 403, f"pages of {text} must not connect; permit them with rosidl-py foxglove --allow-origin"
        if self.token and not self._has_token(path):
            return 401, "the address requires ?token=... of rosidl-py foxglove"
        return None

    def _is_allowed(self, origin: str) -> bool:
        allowed = (*KNOWN_ORIGINS, *(one.rstrip("/") if one != "file://" else one for one in self.origins))
        if ANY in allowed or origin in allowed:
            return True
        try:
            parts = urlsplit(origin)
            return parts.scheme in ("http", "https") and parts.hostname in _LOCAL_HOSTS and parts.username is None
        except ValueError:
            return False

    def _has_token(self, path: str) -> bool:
        try:
            tokens = parse_qs(urlsplit(path).query, max_num_fields=20).get("token", [])
        except ValueError:
            return False
        return len(tokens) == 1 and hmac.compare_digest(tokens[0].encode(errors="replace"), self.token.encode())


class RateLimit:
    """Rate limit of a viewer: `per_s` messages per second, with bursts of as many.

    A faster viewer is read more slowly, so that it has to wait; no message is lost.
    """

    def __init__(self, per_s: int) -> None:
        self._per_s = per_s
        self._left = float(per_s)
        self._at = monotonic()

    def wait_s(self) -> float:
        """Count a message; return the time to wait before reading the next one, in seconds."""
        now = monotonic()
        self._left = min(self._per_s, self._left + (now - self._at) * self._per_s) - 1
        self._at = now
        return max(0.0, -self._left / self._per_s)
