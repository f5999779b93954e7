# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write the figures of README.md and docs/performance.md, and draw docs/images/speed.svg, from bench/results.

`python docs/performance_from_results.py` does both; `make pictures` draws, too. A test compares the pages
with the report. Sentences stay where they are and get new numbers; a table follows the comment that names it.
"""

import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
[RESULTS] = (ROOT / "bench" / "results").glob("*.md")
PAGES = {
    ROOT / "README.md": False,
    ROOT / "docs" / "performance.md": True,
}  # whether a page has all sentences
PICTURE = ROOT / "docs" / "images" / "speed.svg"

# Columns of the report, without the versions of libraries.
OURS, KEPT = "ours: buffer", "ours: buffer, kept"
PYTHON, CPP = "tf2_ros: buffer", "tf2 C++: core"
CONTESTANTS = {
    OURS: "tf2-ros-cython",
    KEPT: "tf2-ros-cython, results kept",
    PYTHON: "Jazzy's tf2_ros, Python",
    CPP: "Jazzy's tf2, called from C++",
}
COLORS = ("#1a7f37", "#7fc796", "#777777", "#b35900")
PEER = "transform-tree: plan"
# Trees of moving frames with 1,000 samples, which turn evenly, and at random.
CHAINS = ("moving chain", "chain with random rotations")
# Lines of the section of lookups.
TYPICAL = {
    "static frames": "static 500, static, 4 hops",
    "the latest time": "dynamic 100, latest, 4 hops",
    "a past time": "dynamic 100, past, 4 hops",
}
NUMBER = re.compile(r"\d+(?:\.\d+)?")
# tf2 searches a history from its newest sample: the longer histories would only raise the largest ratios.
LONG = re.compile(r"0,000 samples")
IS_RECENT = re.compile(r", static,|latest|newest")
# The evaluation of tf2_rs: the smallest and the largest ratio to tf2 in C++ of tf2_rs, and of tf2_py.
PUBLISHED = {"static": ("1.07 to 1.18", "5 to 10"), "dynamic": ("1.00 to 1.01", "1.25 to 1.80")}
PUBLISHED_ONLINE = ((1.40, 1.57), (4, 6))

Line = dict[str, list[float]]


class Section(dict[str, Line]):
    """
    The numbers of each cell, by line and column: the median, the 5th and the 95th percentile.

    :param remark: where and when it was measured.
    """

    def __init__(self, text: str) -> None:
        self.remark = re.findall(r"^- (.*)$", text, re.MULTILINE)[0]
        head, _, *lines = ([*_cells(row)] for row in re.findall(r"^\| .*$", text, re.MULTILINE))
        columns = [re.sub(r" [\d.]+(?=:| C)", "", cell) for cell in head[1:]]
        for name, *cells in lines:
            numbers = ([float(one) for one in NUMBER.findall(cell)] for cell in cells)
            self[name] = {one: found for one, found in zip(columns, numbers, strict=True) if found}

    def median(self, line: str, column: str) -> float:
        return self[line][column][0]

    def medians(self, columns: Iterable[str], lines: str = "") -> list[list[float]]:
        """The medians of these columns, for each line that begins with a text."""
        columns = list(columns)
        return [[of[one][0] for one in columns] for line, of in self.items() if line.startswith(lines)]


def _cells(row: str) -> Iterator[str]:
    return (cell.strip() for cell in row.removeprefix("|").removesuffix("|").split("|"))


def report() -> dict[str, Section]:
    """The sections of the report, by the names that `python -m bench --only` takes."""
    _, *texts = re.split(r"^## ", RESULTS.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.findall(r"--only ([\w:]+)", text)[0]: Section(text) for text in texts}


REPORT = report()
FOUND = REPORT["lookups"]
IS_PAST = {line: not IS_RECENT.search(line) for line in FOUND}


def drawn() -> dict[str, str]:
    """The lines that the table and the picture show, by what they are called there."""

    def beside(line: str) -> float:
        return FOUND.median(line, CPP) / FOUND.median(line, KEPT)

    return {
        **TYPICAL,
        "where C++ is furthest ahead": min(FOUND, key=beside),
        "a past time, where C++ is nearest": min((line for line in FOUND if IS_PAST[line]), key=beside),
    }


def _range(values: Sequence[float], show: Callable[[float], str]) -> str:
    low, high = show(min(values)), show(max(values))
    return low if low == high else f"{low} to {high}"


def _ratio(value: float) -> str:
    return f"{value:.0f}" if value >= 9.5 else f"{value:.2f}" if value >= 0.095 else f"{value:.2g}"


def _percent(value: float) -> str:
    return f"{100 * value:.3g}"


def _time(value: float) -> str:
    return f"{value:.3g} µs" if value < 100 else f"{value:,.0f} µs"


def _rounded_down(value: float) -> str:
    # No page quotes a better one.
    return f"{int(value)}" if value >= 10 else f"{int(value * 100) / 100:g}"


def _milliseconds(value: float) -> str:
    return f"{value / 1e3:.0f}" if value >= 10_000 else f"{value / 1e3:.2g}"


def sentences() -> Iterator[str]:
    """What the report says, for all lines that the words cover."""
    yield from of_headline_and_frames()
    messages = REPORT["receiving:cpu"]
    together, apart = REPORT["nodes"].medians(["ours: together", "ours: apart"])[0]
    yield f"use {_percent(together)} % of a core instead of {_percent(apart)} %."
    kept = [kept - dropped for kept, dropped in FOUND.medians([KEPT, OURS])]
    yield f"cost {_range(kept, '{:.2f}'.format)} µs more: otherwise,"

    def share(transforms: str, *ways: str) -> str:
        pairs = (messages.medians([f"ours: {way}", f"tf2_ros: {way}"], f"{transforms} ")[0] for way in ways)
        return _range([ours / theirs for ours, theirs in pairs], _percent)

    loops, looking = ("spin_once", "executor.spin_once"), "spin_once+lookup"
    yield (
        f"uses {share('1', *loops)} % (1 transform) or {share('50', *loops)} % (50 transforms) of the CPU"
        " time of `tf2_ros` in the same loop; if it also calls `can_transform` in each turn,"
        f" {share('1', looking)} % or {share('50', looking)} %."
    )
    overridden = [own / theirs for own, theirs in messages.medians(["ours: overridden", "tf2_ros: listener"])]
    yield f"uses {_range(overridden, _percent)} % of the CPU time of `tf2_ros`."
    long, short = (FOUND[f"chain of {samples} samples, random, 4 hops"] for samples in ("100,000", "100"))
    growth = [long[one][0] / short[one][0] for one in (OURS, PYTHON, CPP)]
    ours, python, cpp = (f"{float(f'{one:.3g}'):,g}" for one in growth)
    yield (
        f"a lookup at a random past time takes {ours} times as long here, {python} times as long with Jazzy's"
        f" `tf2_ros`, and {cpp} times as long with Jazzy's tf2 in C++."
    )
    whole, *deskewed = (f"ours: {way}" for way in ("do_transform_cloud", "deskew", "deskew, target moves"))
    clouds = [
        (times[0], time) for times in REPORT["clouds"].medians([whole, *deskewed]) for time in times[1:]
    ]
    yield (
        "`deskew` of 100,000 points over 1 and 4 hops takes"
        f" {_range([time for _, time in clouds], '{:,.0f}'.format)} µs,"
        f" {_range([time / whole for whole, time in clouds], '{:.1f}'.format)} times as long as"
        " `do_transform_cloud`."
    )
    yield from _of_frozen()


def of_headline_and_frames() -> Iterator[str]:
    """At which commit the lines of the first table were measured, and lookups beside a listener."""
    sections = ("lookups", "calls", "receiving:cpu", "receiving:waits")
    [commit] = {re.findall(r"commit ([0-9a-f]+)", REPORT[name].remark)[0] for name in sections}
    yield f"measured at commit {commit}"
    online = REPORT["tf2_rs:online"].medians([OURS, PYTHON])
    took = _range([ours for ours, _ in online], "{:.2f}".format)
    ratios = _range([python / ours for ours, python in online], _rounded_down)
    yield (
        f"While a process receives 300 frames, half of which move, a lookup takes {took} µs, and {ratios}"
        " times as long with `tf2_ros`."
    )


def _of_frozen() -> Iterator[str]:
    section = REPORT["frozen"]
    [whole, opened] = [line for line in section if "loaded" not in line]
    write, size, opening = (section.median(whole, f"ours: {way}") for way in ("write", "file", "open"))
    samples = int(NUMBER.findall(whole.replace(",", ""))[0])
    median, low, high = section[opened]["ours: core"]
    yield (
        f"of {samples // 1_000_000} million samples, {size:.0f} bytes each, is written in {write / 1e6:.2g} s"
        f" and opened in {_milliseconds(opening)} ms; in it, `lookup_transform_core` over 4 hops at a random"
        f" time takes {median:.2g} µs (5th to 95th percentile: {low:.2g} to {high:.2g} µs)."
    )


Table = Iterable[tuple[str, ...]]


def of_headline() -> Table:
    """The slowest median here of each kind of line, and the smallest ratios of others in one line."""
    short = {line: of for line, of in FOUND.items() if not LONG.search(line)}
    recent, past = ([of for line, of in short.items() if IS_PAST[line] is one] for one in (False, True))
    timeouts = [of for line, of in REPORT["calls"].items() if re.search(r"lookup.*timeout=duration", line)]
    yield "", "here", "Jazzy's `tf2_ros`", "Jazzy's tf2, called from C++"
    for what, lines, own, others in (
        ("a lookup of static frames, or at the latest time", recent, (OURS, KEPT), (PYTHON, CPP)),
        ("a lookup with a timeout, over 4 hops", timeouts, ("ours: call",), ("tf2_ros: call",)),
        ("a lookup at a past time", past, (OURS, KEPT), (PYTHON, CPP)),
        *(
            (what, list(REPORT[section].values()), (f"ours: {way}",), (f"tf2_ros: {way}",))
            for what, section, way in (
                ("a message received, CPU time", "receiving:cpu", "listener"),
                ("a wait, after the transform was sent", "receiving:waits", "blocked"),
            )
        ),
    ):
        slowest = max(of[one][0] for of in lines for one in own)
        ratios = [
            f"{_rounded_down(min(of[other][0] / of[one][0] for of in lines for one in own))} times"
            for other in others
        ]
        yield what, _time(slowest), *ratios, *["–"] * (2 - len(ratios))


def of_calls() -> Table:
    """Each call of the section, with the time of Jazzy's where it has the call."""
    yield "", "here", "Jazzy's `tf2_ros`"
    for call, of in REPORT["calls"].items():
        yield (
            f"`{call}`",
            _time(of["ours: call"][0]),
            _time(of["tf2_ros: call"][0]) if "tf2_ros: call" in of else "–",
        )


def of_lookups() -> Table:
    none = "–"
    others = "Jazzy's `tf2_ros`", "Jazzy's tf2, called from C++", "transform-tree, a compiled plan"
    yield "", "here", *others
    robot = "between a map and a camera at a past time"
    for name, line in {**drawn(), robot: "robot with 2 moving frames, past, 8 hops"}.items():
        of = {one: _time(numbers[0]) for one, numbers in FOUND[line].items()}
        own = f"{of[OURS]} (kept: {of[KEPT]})"
        yield f"one lookup, {name}: {line}", own, of[PYTHON], of[CPP], of.get(PEER, none)
    online = REPORT["tf2_rs:online"]["online 300, past, 4 hops"]
    heard = [
        f"{online[f'{who}: buffer'][0]:.3g}, {online[f'{who}: p99'][0]:.3g} µs" for who in ("ours", "tf2_ros")
    ]
    yield (
        "a past time over 4 hops, while 300 frames are received, half of them at 50 Hz: median, 99th"
        " percentile",
        *heard, none, none,
    )  # fmt: skip
    used = [f"{100 * online[f'{who}: CPU'][0]:.2g} %" for who in ("ours", "tf2_ros")]
    yield "the CPU time of that process, with 1,000 lookups a second", *used, none, none
    many = [of for line, of in REPORT["vectors"].items() if "sorted, 4 hops" in line]
    ours, peer = (
        f"{_range([of[f'{who}: vector'][0] for of in many], '{:.2g}'.format)} µs"
        for who in ("ours", "transform-tree")
    )
    yield "one of many lookups in one call: all lines with sorted times and 4 hops", ours, none, none, peer
    four = ("ours", "tf2_ros", "tf2 C++", "transform-tree")
    [inserts] = REPORT["inserts"].values()
    yield "`set_transform`", *(f"{inserts[f'{who}: set_transform'][0]:.2g} µs" for who in four)
    [memory] = REPORT["memory"].values()
    resident = (f"{memory[f'{who}: resident'][0]:.0f} bytes" for who in four)
    yield "memory of a sample, 500,000 samples in a history", *resident
    messages = REPORT["receiving:cpu"]
    for transforms, what in ("1", "1 transform, 500"), ("50", "50 transforms, 200"):
        [times] = messages.medians(["ours: listener", "tf2_ros: listener"], f"{transforms} ")
        yield f"CPU time per message: {what} messages a second", *map(_time, times), none, none
    for what, way in (
        ("from `set_transform` until a waiting lookup returns", "own insert"),
        ("from sending a message until a waiting lookup returns", "blocked"),
    ):
        [times] = REPORT["receiving:waits"].medians([f"ours: {way}", f"tf2_ros: {way}"])
        yield what, *(f"{_milliseconds(one)} ms" for one in times), none, none


def of_matrices() -> Table:
    hops = ("1 hop", "4 hops", "10 hops")
    yield "", *hops
    vectors = REPORT["vectors"]
    rows = (
        ("`lookup_matrix`, a random time", FOUND, "random", "matrix", "plan"),
        ("`lookup_matrix` with `out`", FOUND, "random", "matrix out", "plan"),
        ("`lookup_matrices`, 10,000 sorted times", vectors, "sorted", "vector matrices", "vector"),
    )
    for what, section, place, way, plan in rows:
        cells = []
        for number in hops:
            lines = [section[f"{chain}, {place}, {number}"] for chain in CHAINS]
            times = [of[f"ours: {way}"][0] for of in lines]
            ratios = [of[f"ours: {way}"][0] / of[f"transform-tree: {plan}"][0] for of in lines]
            nanoseconds = _range([1000 * one for one in times], "{:.0f}".format)
            cells.append(f"{nanoseconds} ns ({_range(ratios, '{:.2f}'.format)})")
        yield what, *cells


def of_tf2_rs() -> Table:
    """The smallest and the largest ratio of 1, 4 and 10 hops and of all ways to look up."""
    offline, online = REPORT["tf2_rs:offline"], REPORT["tf2_rs:online"]
    own = (OURS, KEPT, "ours: core")
    yield (
        "",
        "tf2_rs, published",
        "tf2_py, published",
        "Jazzy's `tf2_ros` and `tf2_py`, here",
        "this project, here",
    )

    def beside(lines: Iterable[Line], ways: Iterable[str], other: str) -> str:
        return _range([of[way][0] / of[other][0] for of in lines for way in ways], _ratio)

    for kind, what in ("static", "static frames"), ("dynamic", "moving frames, random times"):
        lines = [of for line, of in offline.items() if line.startswith(kind)]
        python = beside(lines, (PYTHON, "tf2_ros: core"), CPP)
        yield f"{what}: relative to C++", *PUBLISHED[kind], python, beside(lines, own, CPP)
    (rust_low, rust_high), (low, high) = PUBLISHED_ONLINE
    rust, python = f"{rust_low:.2f} to {rust_high:.2f}", f"{low} to {high}"
    yield "moving frames that are received: relative to C++", rust, python, "–", "–"
    relative = _range((rust_low / high, rust_high / low), _ratio)
    ours = beside(online.values(), [OURS], PYTHON)
    yield "moving frames that are received: relative to Python", relative, "1", "1", ours


TABLES = {
    "headline": of_headline,
    "calls": of_calls,
    "lookups": of_lookups,
    "matrices": of_matrices,
    "tf2_rs": of_tf2_rs,
}
PLACE = re.compile(
    r"(?P<head><!-- (?P<name>\w+), by docs/performance_from_results\.py -->\n)(\n\|.*?\n(?=\n|\Z))?",
    re.DOTALL,
)


def with_figures(page: str, has_all: bool) -> str:
    """
    The text of a page, with the figures of the report.

    :param has_all: whether the page has each of the sentences.
    """

    def written(place: re.Match[str]) -> str:
        head, *rows = TABLES[place["name"]]()
        lines = [f"| {' | '.join(row)} |".replace("|  |", "| |") for row in (head, *rows)]
        lines.insert(1, "|---" * len(head) + "|")
        return place["head"] + "\n" + "\n".join(lines) + "\n"

    page = PLACE.sub(written, page)
    for sentence in sentences():
        page, count = _pattern(sentence).subn(sentence.replace("\\", r"\\"), page)
        if has_all and count != 1:
            raise SystemExit(f"{count} places have other numbers, but otherwise these words: {sentence}")
        if count:
            page = _filled(page, sentence)
    return page


def _pattern(sentence: str) -> re.Pattern[str]:
    """These words with any numbers and commits, on any lines."""
    commit, number = r"[0-9a-f]{8}", r"[0-9](?:[0-9.,]*[0-9])?"
    words = (
        commit if re.fullmatch(commit, word) else number.join(map(re.escape, re.split(number, word)))
        for word in sentence.split()
    )
    return re.compile(r"\s+".join(words))


def _filled(page: str, sentence: str) -> str:
    """The page with lines of up to 120 characters in the paragraph that has a sentence."""
    place = page.index(sentence)
    start = max(page.rfind(mark, 0, place) + len(mark) for mark in ("\n\n", "\n- "))
    end = min(at for mark in ("\n\n", "\n- ") if (at := page.find(mark, place)) > 0)
    indent = "  " if page[:start].endswith("\n- ") else ""
    text = textwrap.fill(
        " ".join(page[start:end].split()), 120 - len(indent), break_long_words=False, break_on_hyphens=False
    )
    return page[:start] + text.replace("\n", f"\n{indent}") + page[end:]


def draw(path: Path) -> None:
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    pyplot.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "speed", "font.family": "sans-serif"})
    figure, axis = pyplot.subplots(figsize=(10, 3.6), layout="constrained")
    shown = drawn()
    # Dots, because the length of a bar means nothing on a logarithmic axis.
    for number, (one, name) in enumerate(CONTESTANTS.items()):
        places = [group + 0.2 * (number - 1.5) for group in range(len(shown))]
        medians, lows, highs = zip(*(FOUND[line][one] for line in shown.values()), strict=True)
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
    names = [f"{name}:, {line}".replace(", ", "\n") for name, line in shown.items()]
    axis.set_xticks(range(len(shown)), names, fontsize=8)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False, loc="upper left", ncols=2, fontsize=9)
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


if __name__ == "__main__":
    for path, has_all in PAGES.items():
        path.write_text(with_figures(path.read_text(encoding="utf-8"), has_all), encoding="utf-8")
    draw(PICTURE)
