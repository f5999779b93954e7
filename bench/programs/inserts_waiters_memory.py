"""Measure inserts into full histories, beside waiters and filters, and the memory that samples take."""

import ctypes
import itertools
import os

from measured_library import STEP_NS
from trees_and_queries import START_NS, Tree, bushy, chain

FRAMES = 50
CACHE_S = 10.0
# Longer than the cache, so that every insert drops an old sample, as in a program that runs for long.
SAMPLES = round(CACHE_S * 100) + 100
FAR_NS = 3_600_000_000_000  # ahead of everything that is inserted
FILLING = 10_000  # messages of a filter
MEMORY_SAMPLES = 10_000  # of one frame: 100 s
SETTLED = 10_000  # samples from which on fixed costs no longer show
POSE = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]


class Following:
    """Transforms that continue the histories of some (child, parent), in turn."""

    def __init__(self, start_ns, links):
        stamps = itertools.count(start_ns, STEP_NS)
        self._transforms = ((*link, ns, POSE) for ns in stamps for link in links)

    def take(self, count):
        return list(itertools.islice(self._transforms, count))

    def time(self, rows, sizes, library, title, labels, way="set_transform"):
        """Add the row of so many inserts; those of a warm-up come first."""
        for count in (sizes.warm_up, sizes.inserts):
            function, calls, batch = library.inserts(way, self.take(count))
            times, failed = library.time(function, calls, len(calls), sizes.budget_s)
        rows.add(title, labels, times / batch, failed=failed)


def inserts(rows, sizes, library):
    """By message, batch and serialised message."""
    tree = bushy("inserts", FRAMES + 1, 1.0, SAMPLES, CACHE_S)
    library.load(tree)
    links = [(tree.names[child], tree.names[parent]) for child, parent in tree.links]
    following = Following(tree.newest_ns + 2 * STEP_NS, links)
    for way in library.insert_ways:
        following.time(rows, sizes, library, way, {"frames": FRAMES}, way)


def waiters(rows, sizes, library):
    """`set_transform` beside waiters, by one publisher of the frame or by two that disagree; a filter."""
    tree = Tree("flat", [0] * (FRAMES + 1), [False] + [True] * FRAMES, SAMPLES, CACHE_S)
    world, own, *others = tree.names
    start_ns = tree.newest_ns + 2 * STEP_NS
    # First, because Python would use memory again that other cases have freed.
    library.load(tree)
    _fill_filter(rows, sizes, library, (own, world), start_ns)
    cases = [(f"{of} wait", names, count, [(own, world)]) for count in sizes.waiters
             for of, names in (("its frame", [own]), ("other frames", others))]  # fmt: skip
    fighting = [(own, world), (own, others[0])]
    cases.append(("two publishers disagree on the parent", [own], sizes.fighting_waiters, fighting))
    for what, names, count, links in cases:
        library.load(tree)
        waiting = [
            library.buffer.wait_for_transform_async(world, name, library.time_of(start_ns + FAR_NS))
            for name in itertools.islice(itertools.cycle(names), count)
        ]
        labels = {"waiters": count, "what": what}
        Following(start_ns, links).time(rows, sizes, library, "set_transform", labels)
        if any(future.done() for future in waiting):
            raise RuntimeError("a future that should wait has ended")
        for future in waiting:
            future.cancel()


def _fill_filter(rows, sizes, library, link, start_ns):
    """A filter's messages that wait for one transform: their cost, their memory, and their end."""
    import rclpy
    from geometry_msgs.msg import PointStamped
    from tf2_python import fill_header

    from tf2_ros import MessageFilter

    rclpy.init()
    node = rclpy.create_node("bench_filter")
    passed, labels = [], {"messages queued": sizes.queued}
    queue = MessageFilter(None, library.buffer, link[1], 0, node=node)
    messages = [(PointStamped(),) for _ in range(2 * FILLING + sizes.queued)]
    for (message,) in messages:
        fill_header(message, link[0], start_ns + FAR_NS)
    for i in range(2):  # the first ones use memory again that was freed
        before = rss_bytes()
        for (message,) in messages[i * FILLING : (i + 1) * FILLING]:
            queue.add(message)
    rows.add("a message in the filter", {"messages queued": FILLING}, [(rss_bytes() - before) / FILLING], "B")
    queue.clear()
    queue.registerCallback(passed.append)
    times, _ = library.time(queue.add, messages[2 * FILLING :], sizes.queued, 1e6)
    rows.add("filter.add", labels, times)
    Following(start_ns, [link]).time(rows, sizes, library, "set_transform", labels)
    last = library.inserts("set_transform", [(*link, start_ns + FAR_NS, POSE)])
    times, _ = library.time(*last[:2], 1, 1e6)
    if len(passed) != sizes.queued:
        raise RuntimeError(f"{len(passed)} messages passed")
    rows.add("answering, per message", labels, times / sizes.queued)
    queue.close()
    node.destroy_node()
    rclpy.shutdown()


def memory(rows, sizes, library):
    """Bytes per sample: what each process holds, and what our buffer accounts for while one ring fills."""
    tree = chain("memory", max(1, sizes.resident_samples // MEMORY_SAMPLES), MEMORY_SAMPLES)
    samples, before = len(tree.records), rss_bytes()
    library.load(tree)
    rows.add("resident", {"samples": samples}, [(rss_bytes() - before) / samples], "B")
    if library.counts_bytes:
        library.new_buffer(10**15)
        links = itertools.count(START_NS, STEP_NS)
        per_sample = []
        for count, ns in enumerate(itertools.islice(links, sizes.ring_samples), start=1):
            function, calls, _ = library.inserts("set_transform", [("ring", "world", ns, POSE)])
            function(*calls[0])
            if count >= SETTLED:
                per_sample.append(library.buffer.statistics()["bytes"] / count)
        labels = {"samples": sizes.ring_samples}
        rows.add("ring, fullest", labels, [min(per_sample)], "B")
        rows.add("ring, just grown", labels, [max(per_sample)], "B")


def rss_bytes():
    """What the process holds now, without what its allocator only keeps for later."""
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
