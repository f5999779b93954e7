"""Advice for an import of tf2_py from a clone that is not built."""

import os
import sys


def advice() -> str:
    """Where the clone is, and whether it hides an installed tf2_py."""
    home = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    text = f"{home} is not built for Python {sys.version_info.major}.{sys.version_info.minor}"
    for folder in map(os.path.abspath, sys.path):
        if folder != home and os.path.isfile(os.path.join(folder, "tf2_py", "__init__.py")):
            return f"{text}, and hides the tf2_py in {folder}. cd elsewhere, or run `make build` there"
    return f"{text}. Run `make build` there, or `pip install .` and then cd elsewhere"
