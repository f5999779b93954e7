"""Write the seeds of a target: `python -m reliability.fuzz.seeding <target> <folder>`."""

import sys
from pathlib import Path

from reliability.fuzz.targets import target


def main() -> None:
    """Write each seed to a file of its own."""
    name, folder = sys.argv[1:]
    for number, seed in enumerate(target(name).seeds()):
        Path(folder, f"seed-{number:03}").write_bytes(seed)


if __name__ == "__main__":
    main()
