"""Run of fixed-size values while it still grows, and the struct codes of primitives."""

from __future__ import annotations

from dataclasses import dataclass, field

from rosidl_py_gen.base.fieldtype import PRIMITIVES
from rosidl_py_gen.compiler.codegen.plan import Item, Start

MAX_ALIGN = 8  # docs/internals/protocol.md 2.2
CODES = {base: primitive.code for base, primitive in PRIMITIVES.items()}
RCLPY_CODES = {**CODES, "byte": "c"}
"""Struct codes by primitive, and those of rclpy's flavour, in which a byte is bytes of length 1."""


@dataclass(slots=True)
class OpenRun:
    """A run that still grows."""

    start: Start
    nul: bool
    items: list[Item] = field(default_factory=list)
    pack: list[tuple[str, int]] = field(default_factory=list)  # code and repeat; pads have code x
    unpack: list[tuple[str, int]] = field(default_factory=list)
    size: int = 0
    align: int = 1

    def put(self, code: str, count: int, read: str = "") -> None:
        for codes, letter in ((self.pack, code), (self.unpack, read or code)):
            if codes and codes[-1][0] == letter and letter != "s":
                codes[-1] = (letter, codes[-1][1] + count)
            else:
                codes.append((letter, count))


def struct_code(codes: list[tuple[str, int]]) -> str:
    return "".join(letter if count == 1 else f"{count}{letter}" for letter, count in codes)
