"""
Two hosts on this machine: network namespaces with one link between them, and faults of that link.

The namespaces have no names and belong to processes of this run only, so nothing is left of them however it
ends.
The machine's own network gets no end of the link, and the hosts have no route to anything but each other.
"""

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from reliability.orders import Disobeyed, Servant

ROOT = Path(__file__).resolve().parent.parent
LINK = "link0"
NETWORK = "10.83.47"
LOSS_SEED = 47
# For the processes of the hosts; no other process is in their namespaces, so no other ROS domain is near.
ENVIRONMENT = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "ROS_DOMAIN_ID": "0",
    # All namespaces of a machine would share /dev/shm. Each host has its own, besides.
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
}
FOREIGN = "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "TF2_SHARED_BUFFER", "RMW_IMPLEMENTATION"
# Its processes wait until their standard input ends.
HOST = """
set -e
mount -t tmpfs tmpfs /dev/shm
ip link set lo up
echo '{"answer": "ready"}'
exec cat >&2
"""


class Unavailable(Exception):
    """Namespaces or links cannot be made here; the text says why."""


def become_able() -> None:
    """
    Return if this process may make namespaces; if it may make those of a user, begin anew as root of one.

    Raises
    ------
    Unavailable
        Neither is possible.
    """
    for program in ("ip", "unshare", "nsenter", "mount"):
        if shutil.which(program) is None:
            raise Unavailable(f"the program {program} is not installed")
    refusal = _refusal(["unshare", "--net", "--mount"])
    if refusal is None:
        return
    prefix = ["unshare", "--user", "--map-root-user", "--net", "--mount"]
    if os.geteuid() == 0 or _refusal(prefix) is not None:
        raise Unavailable(f"this user may not make network namespaces: {refusal}")
    os.execvp(prefix[0], [*prefix, sys.executable, *sys.orig_argv[1:]])


def _refusal(prefix):
    """Why a process with this prefix cannot make the links that are needed, or None."""
    attempt = "mount -t tmpfs tmpfs /dev/shm && ip link add end0 type veth peer name end1"
    done = subprocess.run([*prefix, "sh", "-c", attempt], capture_output=True, text=True)
    return None if done.returncode == 0 else done.stderr.strip().splitlines()[-1]


class Host:
    """A network namespace with a /dev/shm of its own, held by a process."""

    def __init__(self, name: str, address: str, stack: contextlib.ExitStack) -> None:
        self.name, self.address = name, address
        command = ["unshare", "--net", "--mount", "sh", "-c", HOST]
        self._holder = stack.enter_context(Servant(f"host {name}", command, dict(os.environ)))
        self._holder.answer()
        self.pid = self._holder.process.pid
        self._stack = stack

    def _prefix(self):
        return ["nsenter", f"--target={self.pid}", "--net", "--mount"]

    def run(self, *command: str) -> str:
        """Run a program of the system on this host; its standard output."""
        done = subprocess.run([*self._prefix(), *command], capture_output=True, text=True)
        if done.returncode:
            raise Disobeyed(f"{' '.join(command)} on host {self.name}: {done.stderr.strip()}")
        return done.stdout

    def start(self, module: str, *arguments: str) -> Servant:
        """Start a Python module on this host; it ends with the network."""
        environment = {name: value for name, value in os.environ.items() if name not in FOREIGN}
        environment.update(ENVIRONMENT)
        path = [str(ROOT), environment.get("PYTHONPATH", "")]
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, path))
        command = [*self._prefix(), sys.executable, "-m", module, *arguments]
        return self._stack.enter_context(Servant(f"{module} on host {self.name}", command, environment))

    def received(self) -> int:
        """How many bytes have come over the link."""
        [link] = json.loads(self.run("ip", "-json", "-statistics", "link", "show", LINK))
        return int(link["stats64"]["rx"]["bytes"])

    def cut(self) -> None:
        self.run("ip", "link", "set", LINK, "down")

    def restore(self) -> None:
        self.run("ip", "link", "set", LINK, "up")

    def configure(self) -> None:
        self.run("ip", "address", "add", f"{self.address}/24", "dev", LINK)
        self.restore()
        links = {link["ifname"] for link in json.loads(self.run("ip", "-json", "link"))}
        routes = {route["dst"] for route in json.loads(self.run("ip", "-json", "route"))}
        assert {"lo", LINK} <= links, links
        # A kernel may put tunnels without an address into each namespace.
        addressed = {
            one["ifname"] for one in json.loads(self.run("ip", "-json", "address")) if one["addr_info"]
        }
        assert addressed <= {"lo", LINK}, addressed
        assert routes <= {f"{NETWORK}.0/24"}, routes


class Network:
    """Two hosts, `a` and `b`, and the link between them, which loses packets if `loss` is above 0."""

    def __init__(self, loss: float, stack: contextlib.ExitStack) -> None:
        self.a = Host("A", f"{NETWORK}.1", stack)
        self.b = Host("B", f"{NETWORK}.2", stack)
        self._relay = None
        self.dropping = None
        if not loss:
            self._connect()
        elif self._has_netem():
            self._connect()
            for host in (self.a, self.b):
                host.run("tc", "qdisc", "add", "dev", LINK, "root", "netem", "loss", f"{loss:%}")
            self.dropping = "netem"
        else:
            self._relay = stack.enter_context(self._start_relay(loss))
            self.dropping = "a relay between two tap devices"
        for host in (self.a, self.b):
            host.configure()

    def _connect(self):
        ends = [["name", LINK, "netns", str(host.pid)] for host in (self.a, self.b)]
        command = ["ip", "link", "add", *ends[0], "type", "veth", "peer", *ends[1]]
        subprocess.run(command, check=True, capture_output=True)

    def _has_netem(self):
        if shutil.which("tc") is None:
            return False
        command = [*self.a._prefix(), "tc", "qdisc", "replace", "dev", "lo", "root", "netem", "loss", "0%"]
        return subprocess.run(command, capture_output=True).returncode == 0

    def _start_relay(self, loss):
        if not os.access("/dev/net/tun", os.R_OK | os.W_OK):
            raise Unavailable("there is neither netem nor a /dev/net/tun to lose packets with")
        pids = [str(self.a.pid), str(self.b.pid)]
        command = [sys.executable, "-m", "reliability.relay", str(loss), str(LOSS_SEED), LINK, *pids]
        relay = Servant("the relay", command, {**os.environ, "PYTHONPATH": str(ROOT)})
        relay.answer()
        return relay

    def lost(self) -> tuple[int, int]:
        """How many packets were lost so far, and how many were sent."""
        if self._relay is not None:
            lost, sent = self._relay.order("count")
            return lost, sent
        lost = sent = 0
        for host in (self.a, self.b):
            [queue] = json.loads(host.run("tc", "-json", "-statistics", "qdisc", "show", "dev", LINK))
            lost += queue["drops"]
            sent += queue["packets"] + queue["drops"]
        return lost, sent


@contextlib.contextmanager
def network(loss: float = 0.0) -> Iterator[Network]:
    """Make a network for a `with` statement; its processes end with it, and with them its namespaces."""
    with contextlib.ExitStack() as stack:
        yield Network(loss, stack)
