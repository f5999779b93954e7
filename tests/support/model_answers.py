"""Compare an answer of the buffer with the model's, and say how close they must be."""

import math
import re

from making import rotation, stamp_ns, translation
from model import ModelError

from tf2_py import TransformException

RELATIVE = 1e-9


def require(condition, what, *facts):
    assert condition, f"{what}: {', '.join(map(repr, facts))}"


def as_model_tells(answer):
    return (
        stamp_ns(answer),
        answer.header.frame_id,
        answer.child_frame_id,
        translation(answer),
        rotation(answer),
    )


def same_numbers(got, want, scale):
    return all(abs(a - b) <= RELATIVE * scale for a, b in zip(got, want, strict=True))


def same_rotation(got, want):
    if same_numbers(got, want, 1.0):
        return True
    # On the edge between the two signs rounding decides.
    x, y, z, w = want
    low, high = sorted((abs(x), abs(y), abs(z)))[1:]
    on_edge = abs(4 * w * w - 1) < 1e-6 or (4 * w * w < 1 and high - low < 1e-6)
    return on_edge and same_numbers(got, tuple(-a for a in want), 1.0)


def same_answer(got, want):
    scale = max(1e3, *(abs(a) for a in want[3]))
    return got[:3] == want[:3] and same_numbers(got[3], want[3], scale) and same_rotation(got[4], want[4])


def without_advice(text):
    """The model does not judge which names resemble each other."""
    return re.sub(r"(does not exist)\. Did you mean \[.*\]\?$", r"\1", text)


def of_buffer(call, *arguments):
    """("answer", it), or ("error", class, text)."""
    try:
        return ("answer", call(*arguments))
    except TransformException as error:
        return ("error", type(error).__name__, without_advice(str(error)))


def of_model(call, *arguments):
    """The same, with all texts that are right."""
    try:
        return ("answer", call(*arguments))
    except ModelError as error:
        return ("error", error.kind, error.texts)


def same_error(got, want):
    return got[:2] == want[:2] and got[2] in want[2]


def same_velocity(got, want):
    linear, angular, duration = want
    if duration == 0:
        return all(map(math.isnan, (*got[0], *got[1])))
    # Places lie up to kilometres apart; of their difference a part of 10⁻⁹ is divided by the time between.
    tolerance = 1e-6 / duration
    pairs = zip((*got[0], *got[1]), (*linear, *angular), strict=True)
    return all(abs(a - b) <= max(tolerance, RELATIVE * abs(b)) for a, b in pairs)
