# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Draw the path of a transform from /tf to a reader, a future and a callback, with the threads that carry it.

`python docs/data_path_figure.py` writes docs/images/data-path.svg, with names of the code, for internals.md,
and data-path-small.svg, without them, for callbacks.md.
"""

from pathlib import Path
from xml.sax.saxutils import escape

IMAGES = Path(__file__).resolve().parent / "images"
PICTURES = {"data-path.svg": True, "data-path-small.svg": False}  # whether it names the code
# Who carries it, in the colors of Okabe and Ito, on white, so that it is legible in a dark page, too.
MIDDLEWARE, INSERTING, BACKGROUND, EXECUTOR, READING = "#666666", "#0072b2", "#00795a", "#b34700", "#8a3d72"
LEGEND = {
    MIDDLEWARE: "the middleware",
    INSERTING: "the thread that inserts: the receiver thread, or the one that reads; without the GIL",
    BACKGROUND: "the background thread, with the GIL",
    EXECUTOR: "the executor or event loop of the node",
    READING: "the thread that reads",
}
# Left, top, width, height; the title, what it is or holds, and the code.
BOXES = (
    (10, 122, 160, 66, "/tf, /tf_static", "serialized messages", "Subscriptions"),
    (265, 122, 170, 66, "inbox", "transforms to insert", "Inbox, ReceivedMessage"),
    (548, 122, 157, 66, "histories", "tree, behind a lock", "Engine, tree_insert"),
    (548, 215, 157, 66, "waiters", "who lacks what", "Waiter, wake_step"),
    (830, 22, 200, 66, "waiting reader", "a lookup with a timeout", "Lookup.block"),
    (830, 165, 200, 66, "future", "a task that awaits it", "Pending, WakingFuture"),
    (830, 250, 200, 66, "callback", "of futures and filters", "CallQueue.run"),
)
# Points; what happens, and the code for it, the middle of both, and their line; the thread.
ARROWS = (
    (((170, 155), (265, 155)), "arrives", "_arrived", (216, 155), MIDDLEWARE),
    (((435, 155), (548, 155)), "is inserted", "drain_when_due", (491, 155), INSERTING),
    (((622, 188), (622, 215)), "", "", (0, 0), INSERTING),
    (((705, 235), (728, 235), (728, 66), (830, 66)), "wakes it", "event_set", (775, 66), INSERTING),
    (((705, 258), (812, 258), (812, 198), (830, 198)), "answers", "Engine.report", (758, 258), BACKGROUND),
    (((812, 258), (812, 283), (830, 283)), "", "", (0, 0), EXECUTOR),
    (((830, 42), (350, 42), (350, 122)), "a read drains the inbox first", "catch_up", (540, 42), READING),
)


def _text(x: float, y: float, text: str, style: str = "", anchor: str = "middle") -> str:
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}" class="{style}">{escape(text)}</text>'


def _box(
    left: int, top: int, width: int, height: int, texts: tuple[str, str, str], has_names: bool
) -> list[str]:
    middle = left + width / 2
    lines = [(texts[0], "title"), (texts[1], ""), *([(texts[2], "code")] if has_names else [])]
    first = top + height / 2 + 5 - 9 * (len(lines) - 1)
    found = [f'<rect x="{left}" y="{top}" width="{width}" height="{height}" rx="6"/>']
    return found + [_text(middle, first + 18 * i, text, style) for i, (text, style) in enumerate(lines)]


def picture(has_names: bool) -> str:
    """The picture as SVG. Without names it is shown smaller, with larger letters."""
    scale, size = (1.0, 13) if has_names else (0.72, 15)
    lines = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1040 425"'
        f' width="{1040 * scale:.0f}" height="{425 * scale:.0f}" role="img">',
        "<title>From /tf to a reader, a future and a callback</title>",
        f"<style>text {{ font: {size}px sans-serif; fill: #222222; }}",
        f".title {{ font-weight: bold; font-size: {size + 2}px; }}",
        ".code { font: 12px monospace; fill: #555555; } rect { fill: #f4f6f8; stroke: #888888; }",
        "path { fill: none; stroke-width: 2.5; }</style>",
        '<rect width="1040" height="425" rx="8" style="fill: #ffffff; stroke: none"/>',
    ]
    for number, color in enumerate(LEGEND):
        lines.append(
            f'<marker id="head{number}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="5"'
            f' markerHeight="5" orient="auto"><path d="M0 0 10 5 0 10z" style="fill: {color}; stroke: none"/>'
            "</marker>"
        )
    for points, what, code, (x, y), color in ARROWS:
        course = " ".join(f"{px} {py}" for px, py in points)
        number = list(LEGEND).index(color)
        lines.append(f'<path d="M{course}" stroke="{color}" marker-end="url(#head{number})"/>')
        if what:
            lines.append(_text(x, y - 8, what))
            if has_names:
                lines.append(_text(x, y + 18, code, "code"))
    for left, top, width, height, *texts in BOXES:
        lines += _box(left, top, width, height, (texts[0], texts[1], texts[2]), has_names)
    for number, (color, who) in enumerate(LEGEND.items()):
        y = 325 + 20 * number
        lines += [f'<path d="M15 {y} 45 {y}" stroke="{color}"/>', _text(55, y + 4, who, anchor="start")]
    return "\n".join([*lines, "</svg>", ""])


def draw() -> None:
    for name, has_names in PICTURES.items():
        (IMAGES / name).write_text(picture(has_names), encoding="utf-8")


if __name__ == "__main__":
    draw()
