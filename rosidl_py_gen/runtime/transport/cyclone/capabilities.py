"""What the loaded library can do for us, beyond what every libddsc can: a sentence for each thing that it cannot.

Decides the words that users read, in `Context.capabilities`, from the doctor, and in the log as soon as it matters.

Source: docs/internals/dds.md 2 and 8.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

YES = "yes"
UNBOUND = "Cyclone DDS before 11 finds no nodes on Fast DDS then; data may leave by the address that a peer announces"


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Each is ``"yes"`` or says why not.

    Attributes:
        services: requests and replies of peers on Fast DDS.
        early_samples: what their writers send before Cyclone is connected with them is asked for.
        type_lookups: they may ask each other for types.
        loopback: localhost mode uses no other network interface.
    """

    services: str = YES
    early_samples: str = YES
    type_lookups: str = YES
    loopback: str = YES

    def shown(self) -> dict[str, str]:
        """By what users call it."""
        return {_SHOWN[name]: value for name, value in asdict(self).items()}

    def complaints(self) -> Iterator[str]:
        """What to tell the user once nodes on Fast DDS are there."""
        for name, sentence in _COMPLAINTS.items():
            if getattr(self, name) != YES:
                yield f"{sentence}: {getattr(self, name)}"


_SHOWN = {
    "services": "services of nodes on Fast DDS",
    "early_samples": "first samples of nodes on Fast DDS",
    "type_lookups": "nodes on Fast DDS that ask each other for types",
    "loopback": "localhost mode on the loopback interface alone",
}
_COMPLAINTS = {
    "services": "services of Fast DDS nodes cannot be used here, topics can",
    "early_samples": "what Fast DDS nodes send in their first second may be lost here",
    "type_lookups": "Fast DDS nodes that ask each other for types, as those of Kilted do, may end this process",
}
