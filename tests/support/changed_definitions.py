"""Random sets of definitions, and changed ones: fields removed, added, moved, renamed or of other types."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hypothesis import strategies as st

from support.definition_strategies import World, values, worlds

if TYPE_CHECKING:
    from support.reference_cdr import Reference


@st.composite
def changed_worlds(draw: st.DrawFn) -> tuple[World, World, Reference, dict[str, Any]]:
    """Draw a set of definitions, a changed set, and a value of the old top type."""
    world = draw(worlds(nasty=False))
    last = len(world.texts) - 1
    chosen = draw(st.sampled_from((last, last, draw(st.integers(0, last)))))
    name, text = world.texts[chosen]
    lines = [line for line in text.splitlines() if line]
    for _ in range(draw(st.integers(1, 2))):
        at = draw(st.integers(0, max(0, len(lines) - 1)))
        match draw(st.integers(0, 7)) if lines else 7:
            case 0:
                del lines[at]
            case 1:
                del lines[-1]
            case 2:
                lines[at], lines[-1] = lines[-1], lines[at]
            case 3:
                lines[at] = lines[at].replace(lines[at].split()[1], "renamed", 1)
            case 4:
                lines[at] = lines[at].replace("<=5", "<=9").replace("<=3]", "]").replace("<=2]", "<=1]")
            case 5:
                swapped = {"uint8": "byte", "byte": "char", "bool": "uint8", "int16": "uint16", "float32": "int32"}
                kind = lines[at].split("[")[0].split()[0]
                lines[at] = (
                    lines[at].replace(kind, swapped.get(kind, kind), 1).split(" ", 2)[0] + " " + lines[at].split()[1]
                )
            case 6:
                lines.insert(at, "int16 inserted")
            case _:
                lines.append(draw(st.sampled_from(("uint8 more", "string more", "float64[2] more"))))
    new = (*world.texts[:chosen], (name, "\n".join(lines) + "\n"), *world.texts[chosen + 1 :])
    reference = world.reference()
    return world, World(new, ()), reference, draw(values(reference, world.top))
