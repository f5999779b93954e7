"""Owns the list of the mutants that no test can kill, with the reasons."""

from pathlib import Path

LIST = Path(__file__).with_name("equivalent.txt")


def read(known):
    """
    The reasons, by the mutant's key, and the keys that are not among the known ones.

    An entry is a mutant as it is printed, and a line with the reason::

        tf2_py/_core/walk.pyx _position
        - statement
        + statement
        because ...
    """
    reasons, stale = {}, []
    for entry in LIST.read_text().split("\n\n"):
        lines = [line for line in entry.strip().splitlines() if not line.startswith("#")]
        if not lines:
            continue
        where, before, after, reason = lines
        file, function, *again = where.split(" ")
        same = int(again[0].removeprefix("#")) - 1 if again else 0
        key = (file, function, before.removeprefix("- "), after[1:].strip(), same)
        if not reason.startswith("because "):
            raise ValueError(f"{LIST.name}: no reason for {' '.join(lines)}")
        if key in known:
            reasons[key] = reason
        else:
            stale.append(key)
    return reasons, stale
