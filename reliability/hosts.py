"""
Cut and restore the link between two hosts, lose packets, and check each answer and each error.

`python -m reliability.hosts` creates two network namespaces as hosts, with one link between them, and no link
to anything else. Host A broadcasts transforms whose numbers encode their stamps. Host B has a buffer and a
listener, and looks transforms up continuously. The exit status is 0 if everything was right, 1 if not, and 77
if this machine does not allow namespaces.
"""

import argparse
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from types import FrameType
from typing import Any, NoReturn

from reliability.network import Network, Unavailable, become_able, network
from reliability.orders import Disobeyed, Servant

S = 1_000_000_000
UNAVAILABLE = 77
SENSORS = list(range(40))
LATER_SENSORS = list(range(40, 50))
LOSS = 0.2
ASKERS, GOAL_S, QUICK_GOAL_S, PATIENCE_S = 2, 20.0, 5.0, 60.0
RATE = 50
# Of a message without overhead: 4 transforms of 8 numbers, a stamp and two names each.
LEAST_BYTES = 4 * (8 * 7 + 8 + 5 + 6)
# A publisher of /tf keeps as many messages for those that have not confirmed them: 2 s at this rate. A
# repair may take longer, because DDS announces every 3 s what it has sent. So a few are lost; none are lost
# if it keeps more.
KEPT, KEPT_LONGER = 100, 1000
MAY_MISS = 0.02
DISCOVERY_S = 30.0
RECOVERY_S = 20.0
# While nothing more is sent, DDS repairs in rounds of 3 s, of which a loss in either direction spoils a
# third; each good one leaves a fifth of what was missing, and what is behind a missing message is held back.
REPAIR_S = 90.0
# By how much a wait may end late on a machine that does other things.
LATE_S = 1.0


class Failed(Exception):
    """Something else happened than should have."""


def expect(condition: object, text: str) -> None:
    if not condition:
        raise Failed(text)


def start(net: Network, depth: int = KEPT) -> tuple[Servant, Servant]:
    """Start a sender and, once it sends, a receiver; wait until that has all static transforms."""
    epoch = str(time.time_ns())
    sender = net.a.start("reliability.host_sender", epoch, str(RATE), str(depth))
    sender.order("mount", sensors=SENSORS)
    sender.order("begin")
    receiver = net.b.start("reliability.host_receiver", epoch, str(depth))
    receiver.order("complete", sensors=SENSORS, within=DISCOVERY_S)
    return sender, receiver


def finish(receiver: Servant) -> dict[str, int]:
    """End the lookups of the receiver; how many there were of each kind."""
    end = receiver.order("end")
    wrong = end["wrong"]
    expect(not wrong, f"{len(wrong)} wrong answers or errors, the first: {wrong[:1]}")
    expect(end["waiters"] == 0, f"{end['waiters']} waiters are left")
    counts: dict[str, int] = end["counts"]
    return counts


def compare(sender: Servant, receiver: Servant, within: float = RECOVERY_S) -> tuple[int, list[int]]:
    """End sending: how many were sent since the first that was received; stamps of those that are missing."""
    sent = sender.order("end")
    deadline = time.monotonic() + within
    held = receiver.order("stamps")
    # The last ones may be on their way, or be repeated.
    while held[-1] != sent[-1] and time.monotonic() < deadline:
        time.sleep(0.1)
        held = receiver.order("stamps")
    expected = [stamp for stamp in sent if stamp >= held[0]]
    expect(set(held) <= set(expected), "something was received that was never sent")
    return len(expected), sorted(set(expected) - set(held))


def answers(counts: dict[str, int]) -> str:
    answered = sum(count for kind, count in counts.items() if kind.endswith("answered"))
    refused = sum(count for kind, count in counts.items() if kind.endswith("refused"))
    return f"{answered} answers right, {refused} refused"


def crossing(net: Network, seconds: float) -> int:
    """How many bytes cross the link in this time; Failed if the transforms take another way."""
    before = net.b.received()
    time.sleep(seconds)
    crossed = net.b.received() - before
    least = int(LEAST_BYTES * RATE * seconds * 0.9)
    expect(crossed >= least, f"{crossed} bytes crossed the link, not {least}: it takes another way")
    shared = net.b.run("ls", "-A", "/dev/shm").split()
    expect(not [name for name in shared if "fastrtps_port" in name], f"shared memory is in use: {shared}")
    return crossed


def reception(seconds: float) -> str:
    """Host B finds host A, gets its static transforms, and what it sends."""
    with network() as net:
        sender, receiver = start(net)
        receiver.order("ask")
        crossed = crossing(net, seconds)
        receiver.order("newer", than_ns=time.time_ns(), within=5.0)
        sent, missing = compare(sender, receiver)
        expect(not missing, f"{len(missing)} of {sent} messages are missing")
        return f"{sent} messages, none missing; {crossed} bytes crossed; {answers(finish(receiver))}"


def cut(seconds: float) -> str:
    """The link is cut while lookups wait; static transforms are published meanwhile."""
    with network() as net:
        sender, receiver = start(net)
        receiver.order("ask")
        crossing(net, 1.0)
        receiver.order("newer", than_ns=time.time_ns(), within=5.0)
        receiver.order("wait", long_s=seconds + RECOVERY_S, short_s=seconds / 2)
        net.a.cut()
        began = time.time_ns()
        sender.order("mount", sensors=LATER_SENSORS)
        # What was on its way arrives.
        time.sleep(0.2)
        silence = receiver.order("silence", seconds=seconds - 0.4, limit_s=seconds + 30.0)
        expect(silence["newest_ns"] <= began, "data of after the cut")
        known = receiver.order("knows", sensors=LATER_SENSORS)
        expect(not known, f"known although the link was cut: {known}")
        time.sleep(max(0.0, seconds - (time.time_ns() - began) / S))
        net.a.restore()
        restored = time.time_ns()
        flowing = receiver.order("newer", than_ns=restored, within=RECOVERY_S)
        complete = receiver.order("complete", sensors=SENSORS + LATER_SENSORS, within=RECOVERY_S)
        waited = receiver.order("waited", limit_s=2 * seconds + 60.0)
        check_waits(waited, seconds)
        time.sleep(1.0)
        sent, missing = compare(sender, receiver)
        # Participants that have forgotten each other also lose what is sent until they meet again.
        end = restored + int((flowing + 0.5) * S)
        elsewhere = [stamp for stamp in missing if not began - S // 10 <= stamp <= end]
        expect(
            not elsewhere,
            f"{len(elsewhere)} messages from outside the cut are missing: {elsewhere[:5]}",
        )
        counts = finish(receiver)
        expect(counts.get("now refused", 0) > 0, "nothing was asked during the cut")
        return (
            f"{silence['refused']} honest errors; {flowing + complete:.2f} s until all is back; "
            f"{len(missing)} of {sent} messages lost in the cut; {answers(counts)}"
        )


def check_waits(waited: dict[str, Any], seconds: float) -> None:
    for name, ended in (("short lookup", "ExtrapolationException"), ("short future", "TimeoutException")):
        result = waited[name]
        expect(result["ended"] == ended, f"{name}: {result}, not {ended}")
        late = result["after"] - seconds / 2
        expect(0.0 <= late <= LATE_S, f"{name} ended {late:.3f} s after its time")
    for name in ("long lookup", "long future"):
        result = waited[name]
        expect(result["ended"] == "answered", f"{name}: {result}, not answered")
        expect(seconds - 1.0 <= result["after"] <= seconds + RECOVERY_S, f"{name}: {result}")


def loss(seconds: float, depth: int, quick: bool) -> str:
    """A fifth of all packets is lost, in each direction; host A also has a buffer server, which B asks."""
    with network(LOSS) as net:
        net.a.start("reliability.host_server")
        sender, receiver = start(net, depth)
        receiver.order("ask")
        goals = {"timeout_s": GOAL_S, "patience_s": PATIENCE_S}
        if quick:
            goals = {"timeout_s": QUICK_GOAL_S, "patience_s": 0.0}
        outcomes = receiver.order("client", 2 * PATIENCE_S + seconds, askers=ASKERS, seconds=seconds, **goals)
        expect(quick or outcomes.get("answered"), f"no goal was answered: {outcomes}")
        began = time.monotonic()
        sent, missing = compare(sender, receiver, REPAIR_S)
        repair = time.monotonic() - began
        allowed = 0 if depth > KEPT else int(MAY_MISS * sent)
        expect(
            len(missing) <= allowed,
            f"{len(missing)} of {sent} messages are missing {repair:.1f} s after the last: {missing[:5]}",
        )
        lost, packets = net.lost()
        share = lost / packets
        expect(0.75 * LOSS < share < 1.25 * LOSS, f"{share:.1%} of {packets} packets were lost")
        of_goals = ", ".join(f"{count} {name}" for name, count in sorted(outcomes.items()))
        return (
            f"{lost} of {packets} packets lost by {net.dropping}; {len(missing)} of {sent} messages missing "
            f"{repair:.1f} s after the last; goals: {of_goals}; {answers(finish(receiver))}"
        )


def terminate(number: int, frame: FrameType | None) -> NoReturn:
    sys.exit(128 + number)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m reliability.hosts",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="a shorter version, 40 to 120 s")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, terminate)
    try:
        become_able()
    except Unavailable as reason:
        print(f"Not run: {reason}")
        return UNAVAILABLE
    # The second cut is longer than DDS remembers a participant of which it hears nothing: 20 s.
    seconds, receptions, cuts, depths = 30.0, [30.0], [10.0, 30.0], [KEPT, KEPT_LONGER]
    if options.quick:
        seconds, receptions, cuts, depths = 3.0, [], [3.0], [KEPT_LONGER]
    scenarios: list[tuple[str, Callable[[], str]]] = [
        *((f"reception for {length:g} s", partial(reception, length)) for length in receptions),
        *((f"cut for {length:g} s", partial(cut, length)) for length in cuts),
        *(
            (f"{LOSS:.0%} lost, depth {depth}", partial(loss, seconds, depth, options.quick))
            for depth in depths
        ),
    ]
    rows = []
    for name, scenario in scenarios:
        began = time.monotonic()
        try:
            figures, word = scenario(), "ok"
        except (Failed, Disobeyed) as error:
            figures, word = str(error), "FAILED"
        except Unavailable as reason:
            figures, word = str(reason), "not run"
        rows.append((word, name, f"{time.monotonic() - began:.0f} s", figures))
        print("{:8}{:22}{:>6}  {}".format(*rows[-1]), flush=True)
    words = [row[0] for row in rows]
    return 1 if "FAILED" in words else UNAVAILABLE if "not run" in words else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
