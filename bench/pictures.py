"""Draw latency boxes by scenario and hop count, and growth curves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.libraries import OURS, Library
from bench.rows import Row, Rows

HOPS = (1, 4, 10)
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
STYLES = {"few pairs": "o-", "all pairs": "o--"}


def draw(rows: Rows, libraries: Mapping[str, Library], folder: Path, stem: str) -> list[Path]:
    """Write both pictures; ImportError where there is no matplotlib."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.ticker import LogLocator, NullFormatter

    shown = [row for row in rows.values() if row.section in ("lookups", "growth")]
    kinds = dict.fromkeys((row.who, row.way) for row in shown)
    looks = {
        (who, way): {
            "color": pyplot.get_cmap("tab20")(i),
            "label": f"{'ours' if who == OURS else libraries[who].title}: {way}",
        }
        for i, (who, way) in enumerate(kinds)
    }
    drawn = []
    for name, make in (("latency", _latency), ("growth", _growth)):
        figure = make(pyplot, rows, looks)
        legend: dict[str, Any] = {}
        for axis in figure.axes:
            handles, labels = axis.get_legend_handles_labels()
            legend |= dict(zip(labels, handles, strict=True))
            axis.set_yscale("log")
            axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_formatter(NullFormatter())
            axis.grid(axis="y", which="both", alpha=0.3)
        figure.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=4)
        drawn.append(folder / f"{stem}-{name}.png")
        figure.savefig(drawn[-1], dpi=110, metadata={"Software": None})
        pyplot.close(figure)
    return drawn


def _latency(pyplot: Any, rows: Rows, looks: Mapping[Any, Mapping[str, Any]]) -> Any:
    figure, axes = pyplot.subplots(2, 2, figsize=(12, 8), sharey=True, layout="constrained")
    width = 0.8 / len(looks)
    for axis, (section, place, title) in zip(axes.flat, SCENARIOS, strict=True):
        for i, (kind, look) in enumerate(looks.items()):
            at = {hops: _of(rows.all(section, place=place, hops=hops), kind) for hops in HOPS}
            found = {HOPS.index(hops): row for hops, row in at.items() if row is not None}
            if not found:
                continue
            boxes = axis.boxplot(
                [[value / 1e3 for value in row.values] for row in found.values()],
                positions=[group + (i - (len(looks) - 1) / 2) * width for group in found],
                widths=0.85 * width,
                whis=(5, 95),
                showfliers=False,
                patch_artist=True,
                manage_ticks=False,
                medianprops={"color": "black", "linewidth": 0.8},
            )
            for box in boxes["boxes"]:
                box.set(facecolor=look["color"], linewidth=0.6, label=look["label"])
        axis.set_title(title)
        axis.set_xticks(range(len(HOPS)), [f"{hops} hops" if hops > 1 else "1 hop" for hops in HOPS])
    for axis in axes[:, 0]:
        axis.set_ylabel("µs per lookup")
    return figure


def _of(rows: list[Row], kind: tuple[str, str]) -> Row | None:
    return next((row for row in rows if (row.who, row.way) == kind and row.unit == "ns"), None)


def _growth(pyplot: Any, rows: Rows, looks: Mapping[Any, Mapping[str, Any]]) -> Any:
    figure, axes = pyplot.subplots(1, 3, figsize=(14, 5), sharey=True, layout="constrained")
    for axis, (what, title) in zip(axes, AXES.items(), strict=True):
        for kind, look in looks.items():
            for pairs, style in STYLES.items():
                points = sorted(
                    (row.labels[what], row.percentile(50) / 1e3)
                    for row in rows.all("growth", pairs=pairs)
                    if (row.who, row.way) == kind and what in row.labels
                )
                if points:
                    label = look["label"] + (", all pairs in turn" if style == "o--" else "")
                    axis.plot(*zip(*points, strict=True), style, **{**look, "label": label}, markersize=4)
        axis.set_xscale("log")
        axis.set_xlabel(title)
    axes[0].set_ylabel("µs per lookup over 4 moving links")
    return figure
