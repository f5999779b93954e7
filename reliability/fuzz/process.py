"""Owns the process that fuzzes one target: `python -m reliability.fuzz.process <target> <libFuzzer's options>`."""

import sys

import atheris

from reliability.fuzz.targets import PACKAGES, target


def main() -> None:
    """Fuzz until libFuzzer's options say that it is enough; it ends the process."""
    name = sys.argv.pop(1)
    with atheris.instrument_imports(include=PACKAGES[name]):
        found = target(name)
    atheris.Setup(sys.argv, found.run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
