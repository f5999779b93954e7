"""Owns lookups that fail, in trees of several sizes at once."""

from geometry_msgs.msg import TransformStamped
from rclpy.time import Time
from ros2_tf2 import AUTHORITY, fill
from serialised import Template
from serving import serve, time_calls

from tf2_py import BufferCore, TransformException

STAMP_NS = 10**12
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
# Target, source and time: nobody has the data for these. Frame f0 hangs from map.
LOOKUPS = {
    "extrapolation": ("map", "f0", 2 * STAMP_NS),
    "unknown frame": ("map", "nobody", STAMP_NS),
    "two trees": ("map", "island", STAMP_NS),
}


class Failing:
    def __init__(self):
        self._buffers = {}

    def order_load(self, frames):
        """A tree of so many frames, and one more that is not connected."""
        buffer = self._buffers[frames] = BufferCore()
        tree = Template(int(frames))
        for i in range(2):
            buffer.set_transforms_cdr(tree.message(STAMP_NS + i, 0.0), AUTHORITY)
            island = fill(TransformStamped(), "island", "sea", STAMP_NS + i, POSE)
            buffer.set_transform(island, AUTHORITY)
        return {}

    def order_fail(self, frames, way, why, count, budget_s):
        target, source, ns = LOOKUPS[why]
        buffer = self._buffers[frames]
        ask = getattr(buffer, way)

        def fail(*arguments):
            try:
                return ask(*arguments)
            except TransformException as error:
                return error

        function = ask if way.startswith("can") else fail
        calls = [(target, source, Time(nanoseconds=ns))]
        times, _, empty = time_calls(function, calls, int(count), float(budget_s))
        return {"ns": times, "empty_ns": empty}


if __name__ == "__main__":
    serve(Failing())
