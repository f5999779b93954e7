"""Takes steps with a pair of a buffer and the model, and finds the fewest steps that show what is broken."""

from contextlib import contextmanager

from model_pair import Pair
from rclpy.logging import LoggingSeverity, get_logger_level, set_logger_level


def run(steps):
    """Take the steps in a new pair: None, or what is broken after the last one that was taken."""
    pair = Pair()
    for number, step in enumerate(steps):
        try:
            pair.take(step)
        except Exception as broken:
            told = broken if isinstance(broken, AssertionError) else repr(broken)
            return f"after step {number}, {step}: {told}"
    return None


def shortest(taken, broken):
    """What is broken, and the shortest sequence found that shows it, of the steps that led there."""
    steps = taken + [broken.query] if getattr(broken, "query", None) else taken
    if not run(steps):
        return f"not again: {broken!r}", steps
    single = singles(steps)
    steps = shrink(single if run(single) else steps)
    return run(steps), steps


def shrink(steps):
    """Drop what is not needed to break it: halves, quarters, ..., single steps, until nothing more can go."""
    size = len(steps)
    while size:
        start, shorter = 0, False
        while start < len(steps):
            without = steps[:start] + steps[start + size :]
            if run(without):
                steps, shorter = without, True
            else:
                start += size
        if size > 1 or not shorter:
            size //= 2
    return steps


def singles(steps):
    """The same with one link in each insert."""
    single = []
    for step in steps:
        if step[0] == "insert":
            single += [("insert", step[1], (link,), step[3]) for link in step[2]]
        else:
            single.append(step)
    return single


def as_text(steps):
    """The steps as a literal, for `run`."""
    return "[\n" + "".join(f"    {step!r},\n" for step in steps) + "]"


@contextmanager
def quiet():
    """Without the log lines of refused transforms."""
    level = get_logger_level("tf2_py")
    set_logger_level("tf2_py", LoggingSeverity.FATAL)
    try:
        yield
    finally:
        set_logger_level("tf2_py", level)
