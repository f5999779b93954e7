"""
Lets each allocation of each operation fail, and compares the buffer with one that nothing happened to.

Run with `interposed/allocations.c` loaded: `run.py SCOPE [OPERATION...]`. SCOPE is `engine`: what the
project's own C code asks for; or `all`: what is asked for in the same thread by whomever, with
PYTHONMALLOC=malloc also all Python objects. Prints a line of JSON for each operation.
"""

import copy
import ctypes
import faulthandler
import gc
import itertools
import json
import os
import pickle
import sys
import tempfile
import threading
import traceback
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from making import S, about_z, at, transform
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from travelling import everything

import tf2_ros_tools.bag
from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore, TransformException
from tf2_ros import Buffer, SharedBufferError

FRAMES = ["map", "base", "camera", "nobody"]
TIMES_NS = [2 * S, 3 * S + S // 2]
MOST = 3000  # allocations of one operation
KEPT = 3  # blocks: of a number or two that this program keeps
OPERATIONS = {}


class Interposed:
    """The variables of `interposed/allocations.c`. Setting them allocates nothing."""

    def __init__(self):
        library = ctypes.CDLL(None)
        for name in ("counted_of", "counted", "first_to_fail", "last_to_fail", "failed", "live"):
            setattr(self, name, ctypes.c_long.in_dll(library, name))
        self.counted_thread = ctypes.c_ulong.in_dll(library, "counted_thread")
        self.failed_at = ctypes.c_void_p.in_dll(library, "failed_at")
        self.found = library.find_ours()


NOBODY, ENGINE, ALL = range(3)
BOTH = (ENGINE, ALL)
memory = Interposed()


class Operation:
    """
    One call, what it is called on, and what must be the same afterwards.

    :param make: makes what the others get.
    :param call: the call; what it returns is compared.
    :param see: what must be as before where the call failed, and as without a failure where it was repeated.
    :param steps: states that a failed call may leave; None: only that of before.
    :param end: frees what `make` made.
    :param scopes: ALL only where nothing but this project and Python's own types is at work: rclpy, NumPy's
        printing and what else there is in C crash without memory.
    """

    def __init__(self, make, call, see=None, *, steps=None, end=None, scopes=(ENGINE,)):
        self.make, self.call, self.see, self.steps = make, call, see or seen, steps
        self.end = end or (lambda made: None)
        self.scopes = scopes


def operation(name, make, **options):
    """Decorates the call."""

    def add(call):
        OPERATIONS[name] = Operation(make, call, **options)
        return call

    return add


def seen(made):
    """All that a buffer answers and lists, and who waits; not how much memory it has."""
    buffer = made.buffer
    buffer._self_check()
    found = everything(buffer, FRAMES, TIMES_NS)
    del found["statistics"]["bytes"]
    found["waits"] = buffer._pending_waits()
    found["answered"] = sorted(map(str, getattr(made, "answered", [])))
    return found


# Buffers to begin with.


def fill(buffer, samples=8):
    for i in range(samples):
        buffer.set_transform(transform("map", "odom", 1 + i, (i, 0, 0)), "one")
        buffer.set_transform(transform("odom", "base", 1 + i, (0, i, 0), about_z(i / 10)), "two")
    buffer.set_transform_static(transform("base", "camera", xyz=(0, 0, 1)), "three")
    return buffer


def filled(**more):
    def make():
        made = SimpleNamespace(buffer=fill(BufferCore(Duration(seconds=100))))
        for name, value in more.items():
            setattr(made, name, value() if callable(value) else value)
        return made

    return make


def named(count, authorities=1):
    """A buffer that knows so many names: the reserved one, `map`, and children."""

    def make():
        buffer = BufferCore()
        for i in range(count - 2):
            buffer.set_transform(transform("map", f"f{i}", 1), f"by {i % authorities}")
        return SimpleNamespace(buffer=buffer)

    return make


def with_waits(blocking=0, notified=0, target="map", source="base", seconds=9):
    def make():
        made = filled()()
        made.answered = []
        made.waits = [made.buffer._wait(target, source, at(seconds)) for _ in range(blocking)]
        made.waits += [
            made.buffer._wait(target, source, at(seconds), notify=made.answered.append)
            for _ in range(notified)
        ]
        return made

    return make


# Inserts.


@operation("a new buffer", lambda: SimpleNamespace(buffer=None), see=lambda made: None)
def _(made):
    return str(BufferCore(3).statistics())


@operation("a new tf2_ros.Buffer", lambda: SimpleNamespace(buffer=None), see=lambda made: None)
def _(made):
    return str(Buffer(3).statistics())


@operation("__init__ again", with_waits(2, 2))
def _(made):
    made.buffer.__init__(3)


def insert(name, make, *arguments, static=False, authority="one", **keywords):
    message = transform(*arguments, **keywords)

    @operation(name, make, scopes=BOTH)
    def _(made):
        method = made.buffer.set_transform_static if static else made.buffer.set_transform
        method(message, authority)


insert("the first insert", lambda: SimpleNamespace(buffer=BufferCore()), "map", "base", 1)
insert("insert, nothing grows", named(10), "map", "f0", 2)
insert("insert, a new frame", filled(), "base", "new", 2)
insert("insert, two new frames", filled(), "new parent", "new child", 2)
insert("insert, a ring grows", filled(), "map", "odom", 9, (9, 0, 0))
insert("insert, a late sample", filled(), "map", "odom", 2.5, (9, 0, 0))
insert("insert, names and tree grow", named(32), "map", "new", 2)
insert("insert, the text of names grows", filled(), "map", "x" * 2000, 2)
insert("insert, authorities grow", named(80, 32), "map", "f0", 2, authority="new")
insert("insert, a new parent", filled(), "map", "base", 9)
insert("insert, a loop", filled(), "camera", "map", 9)
insert("insert, static", filled(), "base", "lidar", static=True)
insert("insert, static becomes dynamic", filled(), "base", "camera", 3)
insert("insert, dynamic becomes static", filled(), "map", "odom", 3, static=True)
insert("insert, wakes 40 blocked threads", with_waits(40), "odom", "base", 9)
insert("insert, moves 40 waits to another lack", with_waits(40, source="new"), "far", "new", 9)


@operation("insert, completes 40 waits", with_waits(0, 40, target="odom"))
def _(made, message=transform("odom", "base", 9)):  # noqa: B008
    made.buffer.set_transform(message, "one")


LIST = [
    *(transform("map", "odom", 9 + i / 10, (i, 0, 0)) for i in range(5)),
    *(transform("base", f"new{i}", 2) for i in range(40)),
]


def list_steps():
    states = []
    for count in range(len(LIST) + 1):
        made = filled()()
        made.buffer.set_transforms(LIST[:count], "one")
        states.append(seen(made))
    return states


@operation("set_transforms", filled(), steps=list_steps, scopes=BOTH)
def _(made):
    made.buffer.set_transforms(LIST, "one")


@operation("set_transforms_cdr", filled(), steps=list_steps, scopes=BOTH)
def _(made, data=serialize_message(TFMessage(transforms=LIST))):  # noqa: B008
    made.buffer.set_transforms_cdr(data, "one")


@operation("clear", with_waits(3, 3), scopes=BOTH)
def _(made):
    made.buffer.clear()


# Lookups.


def asked(name, make, ask, scopes=(ENGINE,)):
    @operation(name, make, scopes=scopes)
    def _(made):
        try:
            return ask(made.buffer)
        except TransformException as error:
            return error


def looped():
    made = filled()()
    made.buffer.set_transform(transform("map", "tip", 5), "one")
    made.buffer.set_transform(transform("tip", "map", 9), "one")
    return made


def wandering():
    made = filled()()
    made.buffer.set_transform(transform("map", "base", 4.5), "one")
    return made


MANY_NS = np.linspace(1 * S, 8 * S, 200).astype(np.int64)
POINTS = np.ones((200, 3))
HALF_A_SECOND = Duration(nanoseconds=S // 2)
TWO = at(2)
asked("lookup", filled(), lambda b: b.lookup_transform_core("map", "camera", 2 * S), scopes=BOTH)
asked("lookup, unknown", filled(), lambda b: b.lookup_transform_core("map", "kamera", 2 * S))
asked("lookup, no data", filled(), lambda b: b.lookup_transform_core("map", "camera", 20 * S))
asked(
    "lookup_full",
    filled(),
    lambda b: b.lookup_transform_full_core("odom", 2 * S, "camera", 3 * S, "map"),
    scopes=BOTH,
)
asked("can_transform", filled(), lambda b: b.can_transform_core("map", "camera", 20 * S), scopes=BOTH)
asked("get_latest_common_time", filled(), lambda b: b.get_latest_common_time("map", "camera"))
asked("lookup_transforms", filled(), lambda b: b.lookup_transforms("map", "camera", MANY_NS), scopes=BOTH)
asked(
    "lookup_transforms, parents change",
    wandering,
    lambda b: b.lookup_transforms("map", "camera", MANY_NS),
    scopes=BOTH,
)
asked(
    "lookup_transforms, a loop", looped, lambda b: b.lookup_transforms("map", "camera", MANY_NS), scopes=BOTH
)
asked(
    "transform_points", filled(), lambda b: b.transform_points(POINTS, MANY_NS, "map", "camera"), scopes=BOTH
)
asked(
    "lookup_transforms, many frames",
    filled(),
    lambda b: b.lookup_transforms("map", ["camera", "base", "odom"] * 8, MANY_NS),
    scopes=BOTH,
)
asked("velocity", filled(), lambda b: b.lookupVelocityCore("camera", "map", 2 * S, HALF_A_SECOND))
asked(
    "lookup_velocities",
    filled(),
    lambda b: b.lookup_velocities("camera", "map", MANY_NS, HALF_A_SECOND, on_missing="nan"),
)
asked("chain", filled(), lambda b: b._chain("map", 2 * S, "camera", 2 * S, "map"))
asked("yaml", named(20), lambda b: b.all_frames_as_yaml(), scopes=BOTH)
asked("string", named(20), lambda b: b.all_frames_as_string(), scopes=BOTH)
asked("dot", named(20), lambda b: b._allFramesAsDot(TWO), scopes=BOTH)
asked("frames", named(20), lambda b: b.frames(), scopes=BOTH)
asked("tree", named(20), lambda b: b.tree(), scopes=BOTH)
asked("repr and statistics", filled(), lambda b: (b.__repr__(), b.statistics()))
asked("names", filled(), lambda b: (b._getFrameStrings(), "map" in b, b._frameExists("base")), scopes=BOTH)
asked("pending waits", with_waits(2, 2), lambda b: b._pending_waits(), scopes=BOTH)


# Waits.


def wait(name, make, *arguments):
    @operation(name, make, scopes=BOTH)
    def _(made):
        one = made.buffer._wait(*arguments)
        answer = one.answer
        one.cancel()
        return answer


wait("wait, answered at once", filled(), "map", "base", at(2))
wait("wait for a name", filled(), "map", "new", at(2))
wait("wait for a time", filled(), "map", "camera", at(20))
wait("wait at two times", filled(), "map", "camera", at(20), "odom", at(30))
wait("wait for a connection", named(40), "f1", "by", at(2))


@operation("100 waits", filled())
def _(made):
    waits = [made.buffer._wait("map", f"new{i}", i * S) for i in range(50)]
    waits += [made.buffer._wait("map", "camera", (20 + i) * S) for i in range(50)]
    return len(waits)


@operation("wait_for, expires", with_waits(3))
def _(made):
    one = made.buffer._wait("map", "base", 20 * S)
    return one.wait_for(1000, lambda: True), one.reason()


def ros_buffer():
    return SimpleNamespace(buffer=fill(Buffer(Duration(seconds=100))))


@operation("lookup_transform with a timeout", ros_buffer)
def _(made):
    try:
        return made.buffer.lookup_transform("map", "camera", 20 * S, 0.0001)
    except TransformException as error:
        return type(error).__name__


@operation("wait_for_transform_async", ros_buffer)
def _(made):
    future = made.buffer.wait_for_transform_async("map", "odom", 9 * S)
    try:
        made.buffer.set_transform(transform("map", "odom", 9), "one")
        return future.done()
    finally:
        future.cancel()


def with_futures():
    made = ros_buffer()
    made.answered = []
    made.futures = [made.buffer.wait_for_transform_async("map", "base", at(9)) for _ in range(4)]
    for future in made.futures[:2]:
        future.add_done_callback(lambda done: made.answered.append(done.result()))
    made.buffer.set_transform(transform("map", "odom", 9), "one")
    return made


def seen_with_futures(made):
    return {**seen(made), "futures": [future.done() and repr(future.result()) for future in made.futures]}


def cancel_futures(made):
    for future in made.futures:
        future.cancel()


@operation("insert, completes futures", with_futures, see=seen_with_futures, end=cancel_futures)
def _(made):
    made.buffer.set_transform(transform("odom", "base", 9), "one")


# Travelling.


def same(buffer):
    return str(seen(SimpleNamespace(buffer=buffer)))


@operation("pickle", filled())
def _(made):
    return len(pickle.dumps(made.buffer))


@operation("unpickle", filled(data=lambda: pickle.dumps(fill(BufferCore()))))
def _(made):
    return pickle.loads(made.data)


@operation("copy", filled(), scopes=BOTH)
def _(made):
    return copy.copy(made.buffer)


@operation("__setstate__", with_waits(3, 3))
def _(made, state=fill(BufferCore(), 5).__getstate__()):  # noqa: B008
    made.buffer.__setstate__(state)


FOLDER = tempfile.TemporaryDirectory(prefix="tf2-allocations-")
SAVED = Path(FOLDER.name, "saved.mcap")
fill(BufferCore()).save(SAVED)


def folder_seen(made):
    return {**seen(made), "files": sorted(os.listdir(FOLDER.name))}


@operation("save", filled(), see=folder_seen)
def _(made):
    made.buffer.save(SAVED)


@operation("load", filled(), see=folder_seen)
def _(made):
    return BufferCore.load(SAVED)


@operation("bag.load", filled(), see=folder_seen)
def _(made):
    return tf2_ros_tools.bag.load(SAVED)


# Sharing. Names are of this process.

NUMBERS = iter(range(10**9))


def new_name():
    return f"allocations-{os.getpid()}-{next(NUMBERS)}"


def stop_sharing(made):
    for one in (getattr(made, "owner", None), made.buffer):
        sharing = one.__dict__.get("_tf2_sharing") if one is not None else None
        for name in ("stop", "close"):
            getattr(sharing, name, lambda: None)()


def refused_without_memory(call):
    # Of sharing, that there is no memory for it is an error of its own.
    def either(made):
        try:
            return call(made)
        except SharedBufferError as error:
            raise MemoryError from error

    return either


def owner(samples=8):
    def make():
        return SimpleNamespace(buffer=fill(Buffer(Duration(seconds=100), share=new_name()), samples))

    return make


def pair(samples=8):
    def make():
        owning = fill(Buffer(Duration(seconds=100), share=new_name()), samples)
        reader = Buffer(attach=owning._tf2_sharing.name)
        reader.tree()  # which reads what is shared
        return SimpleNamespace(owner=owning, buffer=reader)

    return make


def pair_seen(made):
    made.owner._self_check()
    return seen(made)


def stop_both(made):
    stop_sharing(made)


@operation("share", lambda: SimpleNamespace(buffer=fill(Buffer(Duration(seconds=100)))), end=stop_both)
@refused_without_memory
def _(made):
    from tf2_ros._shared.owner import Owner

    made.buffer._tf2_sharing = Owner(made.buffer, new_name())


@operation("attach", owner(), end=stop_both)
@refused_without_memory
def _(made):
    reader = Buffer(attach=made.buffer._tf2_sharing.name)
    told = reader.tree()
    reader._tf2_sharing.close()
    # Not what it returned: a message that there is no memory for is missing, as in a listener's buffer.
    return type(told)


def owner_insert(name, *arguments):
    @operation(f"owner: {name}", owner(), end=stop_both)
    def _(made):
        made.buffer.set_transform(transform(*arguments), "one")


owner_insert("insert", "map", "odom", 8.5)
owner_insert("insert, a ring grows", "map", "odom", 9)
owner_insert("insert, a new frame", "new parent", "new child", 9)


@operation("owner: __setstate__", owner(), end=stop_both)
def _(made, state=fill(BufferCore(), 5).__getstate__()):  # noqa: B008
    made.buffer.__setstate__(state)


@operation("owner: pickle", owner(), end=stop_both)
def _(made):
    return pickle.loads(pickle.dumps(made.buffer, 5))


def grown_pair():
    made = pair()()
    made.owner.set_transforms([transform("map", f"new{i}", 9) for i in range(100)], "ten")
    made.owner.set_transform(transform("odom", "base", 9), "two")
    return made


def only_sound(made):
    # A message for which a reader has no memory is missing there, as in a listener's buffer.
    made.owner._self_check()
    made.buffer._self_check()


@operation("reader: catches up", grown_pair, see=only_sound, end=stop_both)
def _(made):
    made.buffer.can_transform_core("map", "new1", 0)


@operation("reader: lookup_transforms", pair(), see=pair_seen, end=stop_both)
def _(made):
    return made.buffer.lookup_transforms("map", "camera", MANY_NS)


@operation("reader: insert", pair(), see=pair_seen, end=stop_both)
def _(made):
    made.buffer.set_transform(transform("odom", "base", 9), "two")


@operation("reader: pickle", pair(), see=pair_seen, end=stop_both)
def _(made):
    return pickle.loads(pickle.dumps(made.buffer))


# The injection.


def attempt(op, made, scope, first, last):
    """Call with these allocations failing: whether one did, what was raised, what was returned."""
    memory.counted.value = memory.failed.value = 0
    memory.first_to_fail.value, memory.last_to_fail.value = first, last
    raised = returned = None
    call = op.call
    memory.counted_of.value = scope
    try:
        returned = call(made)
    except BaseException as error:
        memory.counted_of.value = NOBODY
        raised = error
    memory.counted_of.value = NOBODY
    return memory.failed.value, raised, told(returned)


def site():
    """Where the last allocation failed, for a person with a debugger."""
    with open("/proc/self/maps") as maps:
        for line in maps:
            fields = line.split()
            start, end = (int(part, 16) for part in fields[0].split("-"))
            if start <= (memory.failed_at.value or 0) < end and len(fields) > 5:
                return f"{fields[5]}+{memory.failed_at.value - start + int(fields[2], 16):#x}"
    return "?"


def told(returned):
    """Text to be compared; of an error its class and text."""
    return same(returned) if isinstance(returned, BufferCore) else repr(returned)


def difference(one, other):
    if isinstance(one, dict) and isinstance(other, dict):
        return {
            key: (one.get(key), other.get(key)) for key in {**one, **other} if one.get(key) != other.get(key)
        }
    return one, other


def check(op, scope, first, last, before, after, answer, allowed, found):
    """One injection; False: there are not so many allocations."""
    made = op.make()
    try:
        failed, raised, returned = attempt(op, made, scope, first, last)
        where = site() if failed else None
        problem = {"allocation": first, "last": last, "where": where}
        if raised is not None and not isinstance(raised, MemoryError):
            text = "".join(traceback.format_exception(raised))
            found.append({**problem, "problem": "another error", "told": text})
        if raised is not None and not failed:
            return False
        raised_it = raised is not None
        del raised
        state = op.see(made)
        if raised_it and state not in allowed:
            found.append({**problem, "problem": "changed", "told": str(difference(before, state))[:2000]})
        if not raised_it and (state, returned) != (after, answer):
            problem["told"] = str((difference(after, state), difference(answer, returned)))[:2000]
            found.append({**problem, "problem": "another result"})
        if raised_it:
            returned = told(op.call(made))
            state = op.see(made)
            if op.steps is None and (state, returned) != (after, answer):
                problem["told"] = str((difference(after, state), difference(answer, returned)))[:2000]
                found.append({**problem, "problem": "another result of the next call"})
        return bool(failed)
    finally:
        op.end(made)


def left_behind(op, scope, count):
    """How many blocks of memory are more after all injections than after the same ones before."""
    lives = []
    for _ in range(10):
        for n in range(1, min(count, 40) + 1):
            made = op.make()
            attempt(op, made, scope, n, n)
            op.end(made)
            del made
        gc.collect()
        lives.append(memory.live.value)
        # What leaks does so each time; what Python keeps for itself now and then does not.
        left = min((after - before for before, after in itertools.pairwise(lives[1:])), default=KEPT + 1)
        if left <= KEPT:
            break
    return left


def run(name, scope):
    """Let each allocation of an operation fail, alone and with all that follow it."""
    op = OPERATIONS[name]
    made = op.make()
    before = op.see(made)
    answer = told(op.call(made))
    after = op.see(made)
    op.end(made)
    made = op.make()
    attempt(op, made, scope, 0, 0)
    count = memory.counted.value
    op.end(made)
    allowed = [before] if op.steps is None else op.steps()
    found = []
    injected = 0
    # Python itself gives up where it gets no memory for its errors either.
    for last in (0, 10**9) if scope == ENGINE else (0,):
        for n in range(1, MOST):
            if not check(op, scope, n, last or n, before, after, answer, allowed, found):
                break
            injected += 1
    left = left_behind(op, scope, count)
    if left > KEPT:
        found.append({"problem": "memory is left behind", "told": f"{left} blocks"})
    return {"operation": name, "allocations": count, "injected": injected, "found": found}


def run_apart(name, scope):
    """The same in a forked child, of which a crash is reported as what is found."""
    with tempfile.TemporaryFile("w+") as said, tempfile.TemporaryFile("w+") as trace:
        child = os.fork()
        if child == 0:
            status = 1
            try:
                faulthandler.enable(trace)
                print(json.dumps(run(name, scope)), file=said, flush=True)
                status = 0
            except BaseException:
                traceback.print_exc(file=trace)
                trace.flush()
            finally:
                os._exit(status)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        said.seek(0)
        trace.seek(0)
        if status == 0:
            return json.load(said)
        found = [{"problem": f"ended with {status}", "told": trace.read()}]
        return {"operation": name, "allocations": 0, "injected": 0, "found": found}


def main():
    scope = {"engine": ENGINE, "all": ALL}[sys.argv[1]]
    warnings.simplefilter("ignore")
    memory.counted_thread.value = threading.get_ident()
    for name in sys.argv[2:] or OPERATIONS:
        if scope in OPERATIONS[name].scopes:
            print(json.dumps(run_apart(name, scope)), flush=True)


if __name__ == "__main__":
    main()
