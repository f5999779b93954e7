"""Draw latency boxes by scenario and hop count, and growth curves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.lookups import HOPS
from bench.processes import Library
from bench.race import OURS, Row, Rows

SCENARIOS = (
    ("lookups", "static", "static, offline"),
    ("lookups", "past", "dynamic, offline, a past time"),
    ("lookups", "latest", "dynamic, offline, latest"),
    ("online", "past", "dynamic, online, a past time"),
)
AXES = {
    "samples": "samples per frame",
    "frames": "frames in the tree",
    "ancestors": "links above the common ancestor",
}
OUR_NAMES = {"buffer": "Buffer.lookup_transform (ours)", "core": "lookup_transform_core (ours)",
             "vector": "lookup_transforms (ours), per transform"}  # fmt: skip


def draw(rows: Rows, libraries: Mapping[str, Library], folder: Path, stem: str) -> list[Path]:
    """Write both pictures; ImportError where there is no matplotlib."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    drawn = []
    for name, make in (("latency", _latency), ("growth", _growth)):
        figure = make(pyplot, rows, libraries)
        path = folder / f"{stem}-{name}.png"
        figure.savefig(path, dpi=110, metadata={"Software": None})
        pyplot.close(figure)
        drawn.append(path)
    return drawn


def _colours(pyplot: Any, rows: Rows) -> dict[tuple[str, str], Any]:
    kinds = dict.fromkeys(
        (row.who, row.way)
        for row in rows
        if row.section in ("lookups", "growth", "online") and row.way in OUR_NAMES
    )
    palette = pyplot.get_cmap("tab10")
    return {kind: palette(i % 10) for i, kind in enumerate(kinds)}


def _name(libraries: Mapping[str, Library], who: str, way: str) -> str:
    return OUR_NAMES[way] if who == OURS else libraries[who].label + (f" {way}" if who == "ros2" else "")


def _latency(pyplot: Any, rows: Rows, libraries: Mapping[str, Library]) -> Any:
    figure, axes = pyplot.subplots(2, 2, figsize=(12, 8), sharey=True, layout="constrained")
    colours = _colours(pyplot, rows)
    for axis, (section, place, title) in zip(axes.flat, SCENARIOS, strict=True):
        kinds = [kind for kind in colours if rows.find(section, *kind, place=place) is not None]
        width = min(0.2, 0.8 / max(1, len(kinds)))
        for i, kind in enumerate(kinds):
            for group, hops in enumerate(HOPS):
                row = rows.find(section, *kind, place=place, hops=hops)
                if row is not None:
                    position = group + (i - (len(kinds) - 1) / 2) * width
                    _box(axis, row, position, 0.85 * width, colours[kind])
        axis.set_title(title)
        axis.set_xticks(range(len(HOPS)), [f"{hops} hops" if hops > 1 else "1 hop" for hops in HOPS])
        axis.set_yscale("log")
        _label_powers(axis)
        axis.grid(axis="y", which="both", alpha=0.3)
    for axis in axes[:, 0]:
        axis.set_ylabel("µs per lookup")
    for kind, colour in colours.items():
        if rows.find("lookups", *kind) is not None:
            axes[0, 0].bar(0, 0, color=colour, label=_name(libraries, *kind))
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _label_powers(axis: Any) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter(NullFormatter())


def _box(axis: Any, row: Row, position: float, width: float, colour: Any) -> None:
    statistics = {
        "med": row.median / 1e3,
        "q1": row.p25 / 1e3,
        "q3": row.p75 / 1e3,
        "whislo": row.p05 / 1e3,
        "whishi": row.p95 / 1e3,
    }
    axis.bxp(
        [statistics],
        positions=[position],
        widths=width,
        showfliers=False,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": colour, "linewidth": 0.6},
        medianprops={"color": "black", "linewidth": 0.8},
        whiskerprops={"linewidth": 0.6},
        capprops={"linewidth": 0.6},
    )


def _growth(pyplot: Any, rows: Rows, libraries: Mapping[str, Library]) -> Any:
    figure, axes = pyplot.subplots(1, 3, figsize=(14, 5), sharey=True, layout="constrained")
    colours = _colours(pyplot, rows)
    shown: dict[str, Any] = {}
    for axis, (what, title) in zip(axes, AXES.items(), strict=True):
        for kind, colour in colours.items():
            for pairs, style in (("few", "o-"), ("many", "o--")):
                points = sorted(
                    (row.labels["value"], row.median / 1e3)
                    for row in rows
                    if row.section == "growth"
                    and (row.who, row.way) == kind
                    and row.labels["axis"] == what
                    and row.labels["pairs"] == pairs
                )
                if points:
                    name = _name(libraries, *kind) + (", all pairs in turn" if pairs == "many" else "")
                    (shown[name],) = axis.plot(*zip(*points, strict=True), style, color=colour, markersize=4)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel(title)
        _label_powers(axis)
        axis.grid(which="both", alpha=0.3)
    axes[0].set_ylabel("µs per lookup over 4 moving links")
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=3)
    return figure
