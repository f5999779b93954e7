# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Print what README.md and docs/performance.md say of the lookups in bench/results; draw docs/images/speed.svg.

`make pictures` draws; tests/packaging/test_facts_on_pages.py compares the pages with what this prints.
"""

import re
from collections.abc import Callable, Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
[RESULTS] = (ROOT / "bench" / "results").glob("*.md")

# How the columns of the report's first table begin and end.
OURS, KEPT = ("ours", "ours: buffer"), ("ours", "buffer, kept")
PYTHON, CPP = ("tf2_ros", "buffer"), ("tf2", "C++: core")
PEER = ("transform-tree", "plan")  # only in the table
CONTESTANTS = {
    OURS: "tf2-ros-cython",
    KEPT: "tf2-ros-cython, results kept",
    PYTHON: "Jazzy's tf2_ros, Python",
    CPP: "Jazzy's tf2, called from C++",
}
COLORS = ("#1a7f37", "#7fc796", "#777777", "#b35900")
# Lines of that table.
LOOKUPS = {
    "static frames": "static 500, static, 4 hops",
    "moving frames, the latest time": "dynamic 100, latest, 4 hops",
    "moving frames, a past time": "dynamic 100, past, 4 hops",
}
NUMBER = re.compile(r"\d+(?:\.\d+)?")
# tf2 searches a history from its newest sample: the longer histories would only raise the largest ratios.
LONG = re.compile(r"0,000 samples")
IS_RECENT = re.compile(r", static,|latest|newest")


def rows() -> dict[str, dict[tuple[str, str], list[float]]]:
    """
    Microseconds of one lookup, for each line of the report's first table and each library: the median, the
    5th and the 95th percentile.
    """
    lines = [
        line.strip().strip("|").split(" | ") for line in RESULTS.read_text(encoding="utf-8").splitlines()
    ]
    begin = next(i for i, cells in enumerate(lines) if len(cells) > 1)
    heads = [cell.strip() for cell in lines[begin]]
    columns = {
        one: next(i for i, cell in enumerate(heads) if cell.startswith(one[0]) and cell.endswith(one[1]))
        for one in (*CONTESTANTS, PEER)
    }
    found = {}
    for cells in lines[begin + 2 :]:
        if len(cells) < len(heads):
            break
        found[cells[0].strip()] = {
            one: [float(value) for value in NUMBER.findall(cells[column])] for one, column in columns.items()
        }
    return found


def furthest_ahead() -> str:
    """The line in which C++ is ahead of kept results by most."""
    found = rows()
    return min(found, key=lambda line: found[line][CPP][0] / found[line][KEPT][0])


def drawn() -> dict[str, str]:
    """The lines that the table and the picture show, by what they are called there."""
    line = furthest_ahead()
    return {**LOOKUPS, f"where C++ is furthest ahead ({line})": line}


def _range(ratio: Callable[[dict[tuple[str, str], float]], Iterable[float]], is_recent: bool) -> list[float]:
    values = []
    for line, of in rows().items():
        if not LONG.search(line) and bool(IS_RECENT.search(line)) == is_recent:
            values += ratio({one: found[0] for one, found in of.items() if found})
    return [min(values), max(values)]


def sentence() -> str:
    """What all lines with histories of up to 1,000 samples say, whether results are kept or not."""

    def beside(other: tuple[str, str], is_recent: bool) -> str:
        low, high = _range(lambda of: (of[other] / of[OURS], of[other] / of[KEPT]), is_recent)
        # Rounded down: no page quotes a better one.
        return " to ".join(f"{int(one)}" if one >= 10 else f"{int(one * 100) / 100:g}" for one in (low, high))

    times = [_range(lambda of: (of[OURS], of[KEPT]), is_recent) for is_recent in (True, False)]
    low, high = min(one[0] for one in times), max(one[1] for one in times)
    return (
        f"Over 1 to 10 hops, a lookup takes {low:.2f} to {high:.2f} µs. For static frames and at the latest"
        f" time, Jazzy's `tf2_ros` takes {beside(PYTHON, True)} times as long, and tf2 called from C++"
        f" {beside(CPP, True)} times as long; at past times, they take {beside(PYTHON, False)} and"
        f" {beside(CPP, False)} times as long."
    )


def lines() -> list[str]:
    """The rows of the table in docs/performance.md."""
    found = rows()
    table = []
    for name, line in drawn().items():
        of = {one: f"{values[0]:.3g} µs" for one, values in found[line].items() if values}
        cells = [f"{of[OURS]} (kept: {of[KEPT]})", of[PYTHON], of[CPP], of.get(PEER, "–")]
        what = f"a lookup over 4 hops: {name}" if name in LOOKUPS else f"a lookup {name}"
        table.append(f"| {what} | {' | '.join(cells)} |")
    return table


def draw(path: Path) -> None:
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    pyplot.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "speed", "font.family": "sans-serif"})
    figure, axis = pyplot.subplots(figsize=(10, 3.6), layout="constrained")
    found, shown = rows(), drawn()
    # Dots, because the length of a bar means nothing on a logarithmic axis.
    for number, (one, name) in enumerate(CONTESTANTS.items()):
        places = [group + 0.2 * (number - 1.5) for group in range(len(shown))]
        medians, lows, highs = zip(*(found[line][one] for line in shown.values()), strict=True)
        axis.vlines(places, lows, highs, color=COLORS[number])
        axis.plot(places, medians, "o", color=COLORS[number], label=name)
        for place, median in zip(places, medians, strict=True):
            axis.annotate(
                f"{median:.2g} µs", (place, median), (6, -3), textcoords="offset points", fontsize=8
            )
    axis.set_yscale("log")
    axis.set_xlim(-0.5, len(shown) - 0.4)
    axis.set_ylim(0.1, 500)
    axis.set_ylabel("time of one lookup, µs (log):\nmedian, 5th to 95th percentile")
    names = [
        name.replace(", the ", ",\nthe ").replace(", a ", ",\na ").replace(" (", "\n(") for name in shown
    ]
    axis.set_xticks(range(len(shown)), names, fontsize=8)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False, loc="upper left", ncols=2, fontsize=9)
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


if __name__ == "__main__":
    print(sentence(), *lines(), sep="\n")
