"""Owns the options of the programs that draw frames over time."""

from argparse import ArgumentParser

__all__ = ["add_plot_options"]


def add_plot_options(made: ArgumentParser) -> None:
    """Add what is drawn: some frames, or a way."""
    made.add_argument(
        "frames", nargs="*", metavar="FRAME", default=[], help="what to draw; all frames by default"
    )
    made.add_argument(
        "--path",
        nargs=2,
        metavar=("TARGET", "SOURCE"),
        help="draw the way of the frame SOURCE, as seen in the frame TARGET",
    )
