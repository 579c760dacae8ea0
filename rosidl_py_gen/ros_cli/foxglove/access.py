"""Who may connect to the live view, and how much viewers may send.

Decides by what a browser says of itself: it names the page that connects, the Origin, and a page cannot change that.
What is no browser names none, and may say what it likes: a token is what keeps that out.
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
"""Where Foxglove and Lichtblick are served, and what desktop apps may say. Pages opened as a file say
``null``, as do those that hide where they come from."""
_LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
ANY = "*"


@dataclass(frozen=True, slots=True)
class Access:
    """Who may connect.

    Attributes:
        origins: pages that may beside the known ones, such as ``https://example.org``; `ANY` stands for all.
        token: what the address has to carry as ``?token=...``; empty: nothing.
    """

    origins: Sequence[str] = ()
    token: str = ""

    def refusal(self, origins: Sequence[str], path: str) -> tuple[int, str] | None:
        """Why a connection is refused, as a status of HTTP and a sentence; None when it is not.

        Args:
            origins: all Origin headers of the request.
            path: what is asked for, with the query.
        """
        if len(origins) > 1 or not all(map(self._is_allowed, origins)):
            shown = ", ".join(origins)[:100]
            return 403, f"pages of {shown} may not connect; rosidl-py foxglove --allow-origin lets them"
        if self.token and not self._has_token(path):
            return 401, "the address needs ?token=... as rosidl-py foxglove was started with"
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
            given = parse_qs(urlsplit(path).query, max_num_fields=20).get("token", [])
        except ValueError:
            return False
        return len(given) == 1 and hmac.compare_digest(given[0].encode(errors="replace"), self.token.encode())


class RateLimit:
    """How fast one viewer may send: `per_s` messages in the long run, as many at once.

    A viewer that is faster is read more slowly, which makes it wait: nothing it sends is lost.
    """

    def __init__(self, per_s: int) -> None:
        self._per_s = per_s
        self._left = float(per_s)
        self._at = monotonic()

    def wait_s(self) -> float:
        """Count a message; how long to wait before the next one is read, in seconds."""
        now = monotonic()
        self._left = min(self._per_s, self._left + (now - self._at) * self._per_s) - 1
        self._at = now
        return max(0.0, -self._left / self._per_s)
