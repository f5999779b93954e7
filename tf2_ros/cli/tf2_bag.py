"""Owns the program for recorded transforms: which work a command is, and how its failures are told."""

import sys

from tf2_ros_cython.cli.tf2_bag import main

if __name__ == "__main__":  # before all else: `main` says in one line what is missing
    sys.exit(main())

from argparse import Namespace
from collections.abc import Callable, Mapping

from tf2_py import TransformException
from tf2_ros._recordings.problems import BagError
from tf2_ros.cli._bag_contents import check, info
from tf2_ros.cli._bag_pictures import plot, tree, view
from tf2_ros.cli._bag_tables import batch, lookup
from tf2_ros_cython.cli._program import RunError

__all__ = ["bag", "main"]

COMMANDS: Mapping[str, Callable[[Namespace], int]] = {
    "info": info,
    "check": check,
    "lookup": lookup,
    "tree": tree,
    "plot": plot,
    "batch": batch,
    "view": view,
}


def bag(options: Namespace) -> int:
    """Do what the command says; return the exit status."""
    try:
        return COMMANDS[options.command](options)
    except ModuleNotFoundError as lack:
        # One that comes with an extra; the text says which.
        raise RunError(str(lack)) from None
    except (BagError, TransformException) as failure:
        raise RunError(str(failure)) from None
