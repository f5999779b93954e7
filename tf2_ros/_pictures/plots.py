"""Owns what all pictures by matplotlib share: settings, colours, and the file."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

__all__ = ["BLUE", "GREEN", "GREY", "ORANGE", "VERMILION", "file_of", "style"]

# Colours that all eyes tell apart: M. Okabe and K. Ito, Color universal design, 2008; but for the grey.
BLUE, ORANGE, GREEN, VERMILION, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#6E6E6E"

DPI = 100
_SETTINGS: Any = {
    "text.parse_math": False,  # a name with two dollar signs is no formula
    "svg.fonttype": "none",  # text stays text
    "font.size": 9.0,
    "axes.unicode_minus": False,
}


@contextmanager
def style() -> Iterator[None]:
    """In a ``with`` statement: how figures are made and written, without a change for other users."""
    import matplotlib

    with matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        # The letters of some scripts are not in its fonts; they are shown as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def file_of(figure: Any, kind: str) -> bytes:
    """
    A figure as a file.

    :param kind: ``png`` or ``svg``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with style():
        FigureCanvasAgg(figure)
        written = BytesIO()
        figure.savefig(written, format=kind, dpi=DPI)
    return written.getvalue()
