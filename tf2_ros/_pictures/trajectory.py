"""Owns the picture of where a frame was: from above, and its components over time."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tf2_ros._pictures import labels
from tf2_ros._pictures.plots import BLUE, GREEN, ORANGE, style

__all__ = ["trajectory_figure"]

SIZE_IN = (11.0, 5.5)
LINES: list[dict[str, Any]] = [
    {"color": BLUE, "linestyle": "-"},
    {"color": ORANGE, "linestyle": "--"},
    {"color": GREEN, "linestyle": "-."},
]
ARROWS = 12  # along the way
VIEW = 1.25  # side of what is drawn, by the larger side of the way
SMALLEST_M = 1e-3  # of that side: what does not move is not drawn as noise of nanometres
ARROW_SHARE = 0.1  # of the larger side of the way


def trajectory_figure(
    target: str,
    source: str,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    rpy: NDArray[np.float64],
) -> Any:
    """
    Draw the way of a frame in another one, as a figure of matplotlib's.

    :param target: the frame in which it is seen.
    :param source: the frame whose way this is.
    :param times: in seconds, ascending, shape (N,), N of 1 or more.
    :param positions: x y z, in metres, shape (N, 3); NaN where it is unknown.
    :param rpy: roll, pitch and yaw, in radians, shape (N, 3); likewise.
    """
    from matplotlib.figure import Figure

    with style():
        figure = Figure(SIZE_IN, layout="constrained")
        above, over_time = figure.subplots(1, 2, width_ratios=[1.0, 1.2])
        upper, lower = _halves(figure, over_time)
        figure.suptitle(f"{labels.label(source)} in {labels.label(target)}")
        _draw_above(above, positions, rpy[:, 2])
        begin = times[0]
        _draw_components(upper, times - begin, positions, ("x", "y", "z"), "m")
        # Without leaps by whole turns.
        _draw_components(lower, times - begin, _unwrapped(rpy), ("roll", "pitch", "yaw"), "rad")
        upper.tick_params(labelbottom=False)
        lower.set_xlabel(f"seconds since {begin:.3f}")
    return figure


def _halves(figure: Any, axes: Any) -> tuple[Any, Any]:
    grid = axes.get_subplotspec().subgridspec(2, 1)
    axes.remove()
    upper = figure.add_subplot(grid[0])
    return upper, figure.add_subplot(grid[1], sharex=upper)


def _draw_above(axes: Any, positions: NDArray[np.float64], yaw: NDArray[np.float64]) -> None:
    known = np.flatnonzero(~np.isnan(positions).any(axis=1))
    axes.plot(positions[:, 0], positions[:, 1], color=BLUE, linewidth=1.5)
    if len(known):
        x, y = positions[known, 0], positions[known, 1]
        size = max(float(np.ptp(x)), float(np.ptp(y)), SMALLEST_M)
        chosen = known[np.unique(np.linspace(0, len(known) - 1, ARROWS).astype(int))]
        axes.quiver(
            positions[chosen, 0],
            positions[chosen, 1],
            np.cos(yaw[chosen]),
            np.sin(yaw[chosen]),
            angles="xy",
            scale_units="xy",
            scale=1.0 / (ARROW_SHARE * size),
            width=0.007,
            color=GREEN,
            label="its x axis",
            zorder=3,
        )
        axes.plot(x[0], y[0], "o", color="white", markeredgecolor="black", label="first", zorder=4)
        axes.plot(x[-1], y[-1], "s", color="black", label="last", zorder=4)
        axes.set_xlim(*_limits(x, size))
        axes.set_ylim(*_limits(y, size))
    axes.set_aspect("equal")
    axes.set_xlabel("x in m")
    axes.set_ylabel("y in m")
    axes.set_title("from above")
    axes.grid(color="#E4E4E4")
    axes.set_axisbelow(True)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3, frameon=False)


def _limits(values: NDArray[np.float64], size: float) -> tuple[float, float]:
    # A square, however narrow the way is.
    middle = float(values.min() + values.max()) / 2
    return middle - VIEW * size / 2, middle + VIEW * size / 2


def _draw_components(
    axes: Any,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    names: tuple[str, ...],
    unit: str,
) -> None:
    for column, (name, line) in enumerate(zip(names, LINES, strict=True)):
        axes.plot(times, values[:, column], label=name, linewidth=1.5, **line)
    axes.set_ylabel(unit)
    axes.grid(color="#E4E4E4")
    axes.ticklabel_format(useOffset=False)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _unwrapped(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    unwrapped = angles.copy()
    known = ~np.isnan(angles).any(axis=1)
    unwrapped[known] = np.unwrap(angles[known], axis=0)
    return unwrapped
