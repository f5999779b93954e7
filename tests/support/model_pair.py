"""A buffer beside the model: what changes both, by every way of inserting and of travelling."""

import copy
import pickle

from encoding import encode
from model import Model
from model_answers import of_buffer, of_model, require
from model_links import TURNS, message, place
from model_queries import Queries
from rclpy.duration import Duration

from tf2_py import BufferCore
from tf2_ros import Buffer


class Pair(Queries):
    """A buffer and a model that receive the same transforms."""

    def __init__(self):
        super().__init__(Buffer(Duration(nanoseconds=10)), Model(10))
        self.saved = None  # a state of the buffer, and the model of that moment

    def init(self, cache_ns):
        BufferCore.__init__(self.buffer, Duration(nanoseconds=cache_ns))
        self.model = Model(cache_ns)

    def insert(self, way, links, authority):
        """In one call, or one call for each link."""
        static, messages = way.startswith("static"), list(map(message, links))
        taken = [
            self.model.insert(parent, child, ns, place(x), TURNS[turn], authority, static)
            for parent, child, ns, x, turn in links
        ]
        if way.endswith("cdr") and all(hasattr(made.header.stamp, "sec") for made in messages):
            counted = self.buffer.set_transforms_cdr(encode(messages), authority, static)
        elif way.endswith(("list", "cdr")):
            counted = self.buffer.set_transforms(iter(messages), authority, static)
        else:
            put = self.buffer.set_transform_static if static else self.buffer.set_transform
            require([put(made, authority) for made in messages] == [None] * len(links), "an insert returned")
            return
        require(counted == sum(taken), "an insert counted otherwise", counted, taken)

    def clear(self):
        self.buffer.clear()
        self.model.clear()

    def forget(self, name):
        got, wanted = of_buffer(self.buffer.forget, name), of_model(self.model.forget, name)
        self.compare(("forget", name), got, wanted)

    def travel(self, how):
        """Go on with a copy."""
        before = self.buffer
        if how == "pickle":
            self.buffer = pickle.loads(pickle.dumps(before))
        else:
            self.buffer = copy.deepcopy(before) if how == "deepcopy" else copy.copy(before)
        self.model.travel()
        before.clear()  # what the copy has is its own
        before._self_check()

    def save(self):
        self.saved = (self.buffer.__getstate__(), copy.deepcopy(self.model))

    def restore(self):
        """The buffer becomes what was saved."""
        if self.saved is not None:
            state, model = self.saved
            self.buffer.__setstate__(state)
            self.model = copy.deepcopy(model)
            self.model.travel()
