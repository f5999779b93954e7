# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Colors, labels, axes of time and files, the same in all pictures.

Names of frames and publishers come from the network and may contain anything: ``label`` makes them fit.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tf2_py.printable import printable
from tf2_ros_tools.common.options import format_of
from tf2_ros_tools.common.output import write_whole

Records = NDArray[np.void]

# Colors that everyone can distinguish (M. Okabe and K. Ito, Color universal design, 2008), and gray.
BLUE, ORANGE, GREEN, VERMILION, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#6E6E6E"
LONGEST = 60  # characters of a name

Style = dict[str, Any]  # arguments for matplotlib

GAP: Style = {"facecolor": VERMILION, "alpha": 0.3, "edgecolor": VERMILION, "hatch": "///"}


def label(text: str, longest: int = LONGEST) -> str:
    """Escape unprintable characters, and remove the middle of a text that is too long."""
    shown, half = printable(text), longest // 2
    return shown if len(shown) <= longest + 1 else f"{shown[:half]}…{shown[-half:]}"


DPI = 100
_SETTINGS: Any = {
    "text.parse_math": False,  # a name with two dollar signs is not a formula
    "svg.fonttype": "none",  # text stays text ...
    "pdf.fonttype": 42,  # ... that can be searched for
    "font.size": 9.0,
    "axes.unicode_minus": False,
    "date.autoformatter.minute": "%H:%M",
    "date.autoformatter.microsecond": "%H:%M:%S.%f",
}


@contextmanager
def style() -> Iterator[None]:
    """Set how figures look, during a ``with`` statement."""
    import matplotlib

    with matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        # Characters that its fonts lack are shown as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def file_of(figure: Any, kind: str) -> bytes:
    """
    Get the contents of a file with a figure.

    :param kind: ``png``, ``svg`` or ``pdf``.
    """
    written = BytesIO()
    with style():
        figure.savefig(written, format=kind, dpi=DPI)
    return written.getvalue()


FIRST_DATE_S = 1e9  # in 2001; earlier times are simulated, because the clock of a simulation begins at 0
DAY_S = 86_400.0


def show_times(axes: Any, begin: float, end: float) -> None:
    """
    Label the x axis with the time of the clock: UTC, or the seconds of simulated time.

    :param begin: the left edge, in seconds since the epoch of the clock.
    :param end: the right edge, not before ``begin``.
    """
    if end == begin:
        begin, end = begin - 0.5, end + 0.5
    if begin < FIRST_DATE_S:
        axes.ticklabel_format(axis="x", style="plain", useOffset=False)
        axes.set_xlabel("time in s")
    else:
        import matplotlib.dates

        dates: Any = matplotlib.dates  # without types; its times are in days
        locator = dates.AutoDateLocator(minticks=3, maxticks=6)
        first, last = (datetime.fromtimestamp(time, timezone.utc) for time in (begin, end))
        ticks = locator.tick_values(first, last)
        formatter = dates.AutoDateFormatter(locator)
        axes.set_xticks(ticks * DAY_S, map(formatter, ticks))
        axes.set_xlabel(f"time in UTC, from {first:%Y-%m-%d %H:%M:%S} ({begin:.3f} s)")
    axes.set_xlim(begin, end)


def write_plot(name: str, figure: Any) -> None:
    """Write a matplotlib figure in the format that the extension of the file means."""
    write_whole(name, file_of(figure, format_of(name)))
