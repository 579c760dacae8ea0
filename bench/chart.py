"""Draw the chart of docs/reference/speed.md, for light and dark pages: python bench/chart.py.

The figures are geometric means over the first ten messages of ``python bench/codec.py --markdown``.
"""

from __future__ import annotations

from pathlib import Path

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
TIMES = {
    "rosidl-py-gen": (1, 1),
    "rosbags": (5.1, 3.5),
    "mcap-ros2-support-fast": (5.0, 1.4),
    "mcap-ros2-support": (32, 12),
    "pycdr2": (24, 11),
    "ros2-pyterfaces": (34, 16),
}
"""Library -> time to encode and to decode a message, as multiples of the time of rosidl-py-gen."""
COLORS = {"light": ("#1f2933", "#1f4e79", "#e0930f"), "dark": ("#e6e9ef", "#7db8f0", "#ffd43b")}
"""Colours of texts, of bars for encoding, and of bars for decoding."""
LEFT, TOP, PITCH, BAR, SCALE = 190, 44, 44, 15, 13


def chart(text: str, encode: str, decode: str) -> str:
    height = TOP + PITCH * len(TIMES)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 700 {height}" font-family="sans-serif" font-size="15">',
        "<title>Time to encode and decode a message, as multiples of the time of rosidl-py-gen</title>",
    ]
    for x, color, word in ((LEFT, encode, "encode"), (LEFT + 100, decode, "decode")):
        lines += [
            f'<rect x="{x}" y="10" width="15" height="15" fill="{color}"/>',
            f'<text x="{x + 22}" y="23" fill="{text}">{word}</text>',
        ]
    note = "time, as a multiple of rosidl-py-gen's"
    lines.append(f'<text x="{LEFT + 200}" y="23" fill="{text}">{note}</text>')
    for row, (library, times) in enumerate(TIMES.items()):
        y = TOP + row * PITCH
        lines.append(f'<text x="{LEFT - 10}" y="{y + 20}" fill="{text}" text-anchor="end">{library}</text>')
        for index, (time, color) in enumerate(zip(times, (encode, decode), strict=True)):
            top = y + index * BAR
            lines += [
                f'<rect x="{LEFT}" y="{top}" width="{time * SCALE:g}" height="{BAR - 1}" fill="{color}"/>',
                f'<text x="{LEFT + time * SCALE + 6:g}" y="{top + 12}" fill="{text}" font-size="13">{time:g}</text>',
            ]
    return "\n".join([*lines, "</svg>"]) + "\n"


if __name__ == "__main__":
    for scheme, colors in COLORS.items():
        (IMAGES / f"speed-{scheme}.svg").write_text(chart(*colors), encoding="utf-8")
