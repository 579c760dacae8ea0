"""The arithmetic under the layout: aligning, repeating, and a run of fixed-size values while it still grows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from rosidl_py_gen.base.fieldtype import PRIMITIVES
from rosidl_py_gen.compiler.codegen.plan import Item, Start

MAX_ALIGN = 8  # docs/internals/protocol.md 2.2
CODES = {base: primitive.code for base, primitive in PRIMITIVES.items()}
RCLPY_CODES = {**CODES, "byte": "c"}
"""Struct codes by primitive, and those of rclpy's flavour, in which a byte is bytes of length 1."""


def up(position: int, align: int) -> int:
    return position + -position % align


def repeat(position: int, count: int, step: Callable[[int], int | None]) -> int | None:
    """Apply `step` `count` times; remainders modulo 8 repeat after at most 8 steps."""
    seen: dict[int, tuple[int, int]] = {}
    done = 0
    while done < count:
        remainder = position % MAX_ALIGN
        if remainder in seen:
            since, at = seen[remainder]
            period, growth = done - since, position - at
            whole = (count - done) // period
            if whole:
                position += whole * growth
                done += whole * period
                seen = {}
                continue
        seen[remainder] = (done, position)
        following = step(position)
        if following is None:
            return None
        position = following
        done += 1
    return position


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
