# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What all tests share: a ROS domain of their own, and the tf2 under test."""

import gc
import importlib
import os
import platform
import random
import signal
import subprocess
import tempfile

import pytest
import random_runs
import reference
from _pytest.runner import runtestprotocol
from excused_faults import ATTEMPTS, KnownFault
from paths import ROOT, SUPPORT
from processes import Peer, end, start
from ros_domains import claim_domain
from waiting import NeverTold

from tf2_ros_cython._ros_in_use import rclpy_version, running_prefix, running_release

try:
    import hypothesis
    from hypothesis.internal.conjecture import providers
except ModuleNotFoundError:  # few of the tests that hold for the real tf2 need it
    hypothesis = None

# What the shell of a developer may say, and tests must not depend on.
FOREIGN = (
    *("PYTHONDEVMODE", "PYTHONDONTWRITEBYTECODE", "PYTHONINSPECT", "PYTHONIOENCODING", "PYTHONOPTIMIZE"),
    *("PYTHONSAFEPATH", "PYTHONUNBUFFERED", "PYTHONUTF8", "PYTHONWARNINGS", "PYTHON_COLORS"),
    *("FORCE_COLOR", "NO_COLOR", "LINES", "LANGUAGE", "PYTEST_ADDOPTS"),
    *("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT", "ROS_NAMESPACE"),
    *("ROS_DISABLE_LOANED_MESSAGES", "ROS_SECURITY_ENABLE", "ROS_SECURITY_ENCLAVE_OVERRIDE", "ROS_HOME"),
    *("CYCLONEDDS_URI", "ZENOH_CONFIG_OVERRIDE"),
)
FOREIGN_PREFIXES = ("RCUTILS_", "RMW_FASTRTPS_", "FASTRTPS_", "FASTDDS_")

# Before anything imports rclpy.
for _name in [*os.environ]:
    if _name in FOREIGN or _name.startswith(FOREIGN_PREFIXES):
        del os.environ[_name]
DOMAIN = claim_domain()
_log_folder = tempfile.TemporaryDirectory(prefix="tf2-ros-cython-log-")
os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
os.environ["ROS_LOG_DIR"] = _log_folder.name
os.environ["COLUMNS"] = "80"
os.environ["LC_ALL"] = "C.UTF-8"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
# Kilted warns of the variable that earlier ones read, also in programs that must print nothing.
_profiles = "FASTRTPS" if running_release() in ("Humble", "Jazzy") else "FASTDDS"
os.environ[f"{_profiles}_DEFAULT_PROFILES_FILE"] = str(SUPPORT / "fastdds.xml")
# For the tests' own programs.
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [str(ROOT), str(SUPPORT), os.environ.get("PYTHONPATH", "")])
)

if hypothesis is not None:
    # A busy machine takes its time. Nothing is stored between runs: the seed repeats a failure.
    hypothesis.settings.register_profile(
        "tests",
        hypothesis.settings.get_profile("default"),
        deadline=None,
        database=None,
        suppress_health_check=[
            hypothesis.HealthCheck.too_slow,
            hypothesis.HealthCheck.function_scoped_fixture,
        ],
    )
    hypothesis.settings.load_profile("tests")
    # It would also draw constants that it finds in the modules imported so far, and these depend on the tests
    # that ran before in the same process.
    providers._get_local_constants = lambda: providers._local_constants

# Helpers that assert.
pytest.register_assert_rewrite(
    "buffer_beside_model", "documentation_pages", "fuzz_target_checks", "recorded_answers"
)

_never_told = pytest.StashKey()

# Of a test marked `long`: some build and install for a minute on an idle machine.
LONG_TIMEOUT_S = 1200


def pytest_addoption(parser):
    parser.addoption(
        "--all",
        action="store_true",
        help="run the tests marked `long`, too, and those marked `repeated` more often",
    )
    parser.addoption("--long", action="store_true", help="run only what `--all` adds")
    parser.addoption(
        "--seed",
        default="0",
        help="search from this seed, or from a `new` one, in everything that depends on chance; default: 0",
    )
    parser.addoption(
        "--reference",
        action="store_true",
        help="run the tests marked `tf2` against the tf2_py and tf2_ros of the environment",
    )
    parser.addoption(
        "--record",
        action="store_true",
        help="with --reference: write down what the programs of tests/support/programs/users print there",
    )


def pytest_configure(config):
    # A shell starts what it runs in the background without Ctrl-C, and the tests' own programs inherit that.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    config.addinivalue_line(
        "markers",
        "tf2(*series): holds for the real tf2, too, in every release or in these series, such as 0.36; "
        "run by `pytest --reference`",
    )
    config.addinivalue_line(
        "markers", "long(why): run by `pytest --all` only, as it takes long or needs more than the others"
    )
    config.addinivalue_line("markers", "repeated: more often by `pytest --all` and `pytest --long`")
    random_runs.all_of_them = config.getoption("--all") or config.getoption("--long")
    seed = config.getoption("--seed")
    # The processes of `pytest -n` have it from the first one, and so have the tests' own programs.
    if not hasattr(config, "workerinput"):
        os.environ[random_runs.VARIABLE] = str(random.randrange(10**6)) if seed == "new" else seed
    config.option.hypothesis_seed = os.environ[random_runs.VARIABLE]
    if config.getoption("--reference"):
        reference.reveal()
        # With tf2, messages are work of the executor, and rclpy's drops what is left at its end.
        config.addinivalue_line("filterwarnings", "ignore:coroutine 'Executor._make_handler:RuntimeWarning")
    elif config.getoption("--record"):
        raise pytest.UsageError("--record: what this project prints is no recording; add --reference")


def pytest_ignore_collect(collection_path, config):
    # The other files may import modules that tf2 lacks.
    if config.getoption("--reference") and collection_path.suffix == ".py":
        return "mark.tf2" not in collection_path.read_text(encoding="utf-8") or None
    return None


def pytest_collection_modifyitems(config, items):
    left_out = [item for item in items if _is_left_out(item, config)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in set(left_out)]
    for item in items:
        is_long = any(item.iter_markers("long")) or any(item.iter_markers("repeated"))
        if is_long and not any(item.iter_markers("timeout")):
            item.add_marker(pytest.mark.timeout(LONG_TIMEOUT_S))
    # The processes of `pytest -n` begin the files in this order. A long file of waits must not be the last.
    items.sort(key=lambda item: item.path.parent.name not in ("ros", "programs", "live"))
    for item in items if config.getoption("--reference") else ():
        series = [one for mark in item.iter_markers("tf2") for one in mark.args]
        if series and not reference.holds(series):
            item.add_marker(pytest.mark.skip(reason=f"holds for tf2 {' and '.join(series)} only"))


def _is_left_out(item, config):
    if config.getoption("--reference") and not any(item.iter_markers("tf2")):
        return True
    if config.getoption("--all"):
        return False
    if config.getoption("--long"):
        return not any(item.iter_markers("long")) and not any(item.iter_markers("repeated"))
    return any(item.iter_markers("long"))


def pytest_report_header(config):
    return [f"seed {random_runs.first_seed()}: `pytest --seed` repeats a run with another one"]


def pytest_terminal_summary(terminalreporter, config):
    """Print the versions with which the tests ran, which `make prove` reads."""
    prefix = running_prefix()
    versions = [f"Python {platform.python_version()}", f"rclpy {prefix and rclpy_version(prefix)}"]
    if config.getoption("--reference"):
        versions.append(f"the real tf2 {'.'.join(map(str, reference.release))}")
    terminalreporter.write_line(f"ran with {', '.join(versions)}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    if call.excinfo is not None and call.excinfo.errisinstance(NeverTold):
        item.stash[_never_told] = str(call.excinfo.value)
    return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """Run a test that raises NeverTold again, at most three times in all."""
    for _ in range(ATTEMPTS - 1):
        item.stash[_never_told] = None
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        if item.stash[_never_told] is None:
            item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
            for report in reports:
                item.ihook.pytest_runtest_logreport(report=report)
            item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
            return True
        item.warn(KnownFault(item.stash[_never_told]))
        item._initrequest()  # the next run has fixtures of its own
    return None  # pytest itself runs it the last time


@pytest.fixture(scope="session")
def tf2_py():
    """The tf2_py under test; tests do not import it."""
    return importlib.import_module("tf2_py")


@pytest.fixture(scope="session")
def tf2_ros():
    """The tf2_ros under test; tests do not import it."""
    return importlib.import_module("tf2_ros")


@pytest.fixture(scope="module", autouse=True)
def only_its_own_garbage():
    """
    A module's tests collect the garbage of that module alone: tests that collect hundreds of times would pay
    each time for all that other modules' tests have imported.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module")
def no_refusals_logged():
    """No log lines of refused transforms."""
    from rclpy.logging import LoggingSeverity, set_logger_level

    set_logger_level("tf2_py", LoggingSeverity.FATAL)
    yield
    set_logger_level("tf2_py", LoggingSeverity.UNSET)


@pytest.fixture
def ros():
    """A running rclpy."""
    import rclpy

    rclpy.init(args=[])
    yield rclpy
    rclpy.try_shutdown()
    # Here, where nothing runs, and not in a thread of a later test: what is left of the middleware is
    # destroyed with the GIL held, and may wait for threads of the middleware.
    gc.collect()


@pytest.fixture
def new_node(ros):
    """Makes nodes as `rclpy.create_node` does; they are destroyed before the next test."""
    nodes = []

    def create(*arguments, **options):
        nodes.append(ros.create_node(*arguments, **options))
        return nodes[-1]

    yield create
    for node in nodes:
        node.destroy_node()


@pytest.fixture
def node(new_node):
    """A node without an executor."""
    return new_node("listening")


@pytest.fixture
def buffer(tf2_ros):
    return tf2_ros.Buffer()


@pytest.fixture
def listener(tf2_ros, buffer, node):
    listener = tf2_ros.TransformListener(buffer, node)
    yield listener
    listener.unregister()


@pytest.fixture(params=["inbox", "executor"])
def inserter(request, monkeypatch):
    """What inserts the transforms of a listener: its inbox, or the executor that spins the node."""
    if request.param == "executor":
        if request.config.getoption("--reference"):
            pytest.skip("no inbox in the reference")
        monkeypatch.setattr("tf2_ros.transform_listener.problem", lambda: "it is new")
    return request.param


@pytest.fixture
def executor(ros, node):
    """An executor that holds `node`; see `until`."""
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    yield executor
    executor.shutdown()


@pytest.fixture
def peer():
    """Starts peers, other processes that publish on command; see `processes.Peer`."""
    peers = []

    def start(*ros_arguments):
        peers.append(Peer(*ros_arguments))
        return peers[-1]

    yield start
    for one in peers:
        one.end()


@pytest.fixture
def flood():
    """Starts `programs/floods_tf.py`: messages per second, transforms each, how many messages."""
    processes = []

    def start_flood(rate, count, messages=0):
        arguments = map(str, (rate, count, messages))
        processes.append(start("floods_tf.py", *arguments, stdout=subprocess.PIPE))
        return processes[-1]

    yield start_flood
    for process in processes:
        end(process)
        process.stdout.close()
