"""Random inserts into a buffer: good and odd transforms, clearings, and frames that are forgotten."""

from hypothesis import strategies as st
from making_objects import transform

NAMES = ("a", "b", "c", "d", "/e", "")
FRAMES = ("a", "b", "c", "d", "e", "nowhere")

numbers = st.sampled_from([0.0, -0.0, 1.0, 0.1, -1e6, 1e-300, float("nan"), float("inf")])
turns = st.sampled_from(
    [(0, 0, 0, 1), (0, 0, 0, -2), (1, 0, 0, 0), (0.1, 0.2, 0.3, 0.4), (0, -1, 0, 0), (0, 0, 0, 0)]
)
links = st.builds(
    lambda parent, child, ns, x, turn: transform(parent, child, xyz=(x, x, 1.0), xyzw=turn, ns=ns),
    st.sampled_from(NAMES),
    st.sampled_from(NAMES),
    st.integers(0, 20) | st.integers(2**31 * 10**9 - 3, 2**31 * 10**9 - 1),
    numbers | st.floats(-10, 10),
    turns,
)
authorities = st.sampled_from(["", "x", "y", "(too many authorities)"])
inserts = st.tuples(st.sampled_from(["dynamic"] * 4 + ["static"]), st.lists(links, max_size=8), authorities)
forgets = st.tuples(st.just("forget"), st.sampled_from(FRAMES), st.just(""))
steps = st.lists(inserts | inserts | st.just(("clear", (), "")) | forgets, max_size=25)


def apply(buffer, history):
    for what, subject, authority in history:
        if what == "clear":
            buffer.clear()
        elif what != "forget":
            buffer.set_transforms(subject, authority, what == "static")
        elif subject in buffer:
            buffer.forget(subject)
