# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Print the rows of docs/performance.md that come from bench/results, and draw them as docs/images/speed.svg.

`make pictures` draws; tests/packaging/test_facts_on_pages.py compares the rows with the page.
"""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
[RESULTS] = (ROOT / "bench" / "results").glob("*.md")

# Lines of the report's first table.
LOOKUPS = {
    "static frames": "static 500, static, 4 hops",
    "moving frames, the latest time": "dynamic 100, latest, 4 hops",
    "moving frames, a past time": "dynamic 100, past, 4 hops",
}
# How its columns begin and end.
CONTESTANTS = {
    ("ours", "buffer"): "tf2-ros-cython",
    ("tf2_ros", "buffer"): "Jazzy's tf2_ros, Python",
    ("tf2", "C++: core"): "Jazzy's tf2, called from C++",
}
# Only in the table.
PEER = ("transform-tree", "plan")
COLORS = ("#1a7f37", "#777777", "#b35900")
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def times() -> dict[str, list[list[float]]]:
    """
    Microseconds of one lookup, for each line of LOOKUPS, in the order of CONTESTANTS, and of PEER: the
    median, the 5th and the 95th percentile.
    """
    lines = [line.split(" | ") for line in RESULTS.read_text(encoding="utf-8").splitlines()]
    head = next(cells for cells in lines if len(cells) > 1)
    columns = [
        next(i for i, cell in enumerate(head) if cell.startswith(begin) and cell.rstrip(" |").endswith(end))
        for begin, end in [*CONTESTANTS, PEER]
    ]
    first = {cells[0].removeprefix("| "): cells for cells in reversed(lines)}
    return {
        name: [[float(value) for value in NUMBER.findall(first[line][column])] for column in columns]
        for name, line in LOOKUPS.items()
    }


def lines() -> list[str]:
    """The rows of the table in docs/performance.md."""
    return [
        f"| a lookup over 4 hops: {name} | " + " | ".join(f"{median:.3g} µs" for median, *_ in found) + " |"
        for name, found in times().items()
    ]


def draw(path: Path) -> None:
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    pyplot.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "speed", "font.family": "sans-serif"})
    figure, axis = pyplot.subplots(figsize=(8, 3.2), layout="constrained")
    found = times()
    # Dots, because the length of a bar means nothing on a logarithmic axis.
    for number, name in enumerate(CONTESTANTS.values()):
        places = [group + 0.2 * (number - 1) for group in range(len(found))]
        medians, lows, highs = zip(*(row[number] for row in found.values()), strict=True)
        axis.vlines(places, lows, highs, color=COLORS[number])
        axis.plot(places, medians, "o", color=COLORS[number], label=name)
        for place, median in zip(places, medians, strict=True):
            axis.annotate(
                f"{median:.2g} µs", (place, median), (7, -3), textcoords="offset points", fontsize=9
            )
    axis.set_yscale("log")
    axis.set_xlim(-0.35, len(found) - 0.5)
    axis.set_ylim(0.2, 300)
    axis.set_ylabel("time of one lookup, µs (log):\nmedian, 5th to 95th percentile")
    axis.set_xticks(range(len(found)), found)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False, loc="upper left")
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


if __name__ == "__main__":
    print("\n".join(lines()))
