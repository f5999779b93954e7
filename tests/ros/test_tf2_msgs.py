"""The interfaces of tf2: their fields, their type hashes, and that they travel between processes.

Run as a program, this file is the other process: it publishes, serves and acts until its input closes.
"""

import ctypes
import os
import subprocess
import sys
import threading
import time

import pytest

rclpy = pytest.importorskip("rclpy")

from action_msgs.msg import GoalStatus  # noqa: E402
from builtin_interfaces.msg import Duration, Time  # noqa: E402
from geometry_msgs.msg import TransformStamped  # noqa: E402
from rclpy.action import ActionClient, ActionServer  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402

from tf2_msgs.action import LookupTransform  # noqa: E402
from tf2_msgs.msg import TF2Error, TFMessage  # noqa: E402
from tf2_msgs.srv import FrameGraph  # noqa: E402

TYPE_HASHES = {
    "msg/TFMessage": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "msg/TF2Error": "RIHS01_db2485e7d6a0ec75bf087e058ee45df682acc3a621ca7780503d10aac141809a",
    "srv/FrameGraph": "RIHS01_0d1fbc6222c018ba5f33822904a2fdd4063705289956d3fdde07cd8c50fe8067",
    "action/LookupTransform": "RIHS01_0b8adf6bc0b5958879e3265b41a457e03558fe523890a81252c70eba97a82c5d",
}

DEADLINE_S = 60.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def make_transform(parent, child):
    transform = TransformStamped()
    transform.header.stamp = Time(sec=12, nanosec=345)
    transform.header.frame_id = parent
    transform.child_frame_id = child
    transform.transform.translation.x = 1.5
    transform.transform.rotation.w = 1.0
    return transform


class TypeHash(ctypes.Structure):
    """rosidl's `rosidl_type_hash_t`."""

    _fields_ = [("version", ctypes.c_uint8), ("value", ctypes.c_uint8 * 32)]


@pytest.mark.parametrize("name", TYPE_HASHES)
def test_type_hash_in_the_type_support_is_that_of_ros(name):
    """The compiled type support is what rcl and the RMW ask; the Python classes carry no hash."""
    kind, interface = name.split("/")
    # By bare name, as ROS opens them: it is loaded already.
    library = ctypes.CDLL("libtf2_msgs__rosidl_generator_c.so")
    get_type_hash = library[f"tf2_msgs__{kind}__{interface}__get_type_hash"]
    get_type_hash.argtypes = [ctypes.c_void_p]
    get_type_hash.restype = ctypes.POINTER(TypeHash)
    type_hash = get_type_hash(None).contents
    assert f"RIHS{type_hash.version:02}_{bytes(type_hash.value).hex()}" == TYPE_HASHES[name]


def test_fields_are_those_of_ros():
    fields = {cls: cls.get_fields_and_field_types() for cls in (TFMessage, TF2Error)}
    assert fields[TFMessage] == {"transforms": "sequence<geometry_msgs/TransformStamped>"}
    assert fields[TF2Error] == {"error": "uint8", "error_string": "string"}
    assert FrameGraph.Request.get_fields_and_field_types() == {}
    assert FrameGraph.Response.get_fields_and_field_types() == {"frame_yaml": "string"}
    assert LookupTransform.Goal.get_fields_and_field_types() == {
        "target_frame": "string",
        "source_frame": "string",
        "source_time": "builtin_interfaces/Time",
        "timeout": "builtin_interfaces/Duration",
        "target_time": "builtin_interfaces/Time",
        "fixed_frame": "string",
        "advanced": "boolean",
    }
    assert LookupTransform.Result.get_fields_and_field_types() == {
        "transform": "geometry_msgs/TransformStamped",
        "error": "tf2_msgs/TF2Error",
    }
    assert LookupTransform.Feedback.get_fields_and_field_types() == {}


def test_error_numbers_are_those_of_ros():
    names = ("NO", "LOOKUP", "CONNECTIVITY", "EXTRAPOLATION", "INVALID_ARGUMENT", "TIMEOUT", "TRANSFORM")
    assert [getattr(TF2Error, f"{name}_ERROR") for name in names] == list(range(7))


def test_message_survives_its_own_bytes():
    from rclpy.serialization import deserialize_message, serialize_message

    message = TFMessage(transforms=[make_transform("map", "odom"), make_transform("odom", "base_link")])
    assert deserialize_message(serialize_message(message), TFMessage) == message


def test_messages_import_before_rclpy():
    program = "import sys, tf2_msgs.msg; assert 'rclpy' not in sys.modules; tf2_msgs.msg.TFMessage()"
    subprocess.run([sys.executable, "-c", program], check=True, timeout=DEADLINE_S)


class Here:
    """A node of this process and the spinning of it until something has happened."""

    def __init__(self, name):
        self._context = rclpy.Context()
        # Fast DDS takes its ports from the domain; above 101 they meet those that the system hands out.
        domain = int(os.environ.get("ROS_DOMAIN_ID") or 1 + os.getpid() % 101)
        rclpy.init(context=self._context, domain_id=domain)
        self.domain = domain
        self.node = rclpy.create_node(name, context=self._context)
        self.executor = SingleThreadedExecutor(context=self._context)
        self.executor.add_node(self.node)

    def wait_until(self, condition, what):
        deadline = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline, f"waited {DEADLINE_S} s for {what}"
            self.executor.spin_once(timeout_sec=0.05)

    def result_of(self, future, what):
        self.wait_until(future.done, what)
        return future.result()

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)


@pytest.fixture(scope="module")
def here():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        side = Here("tf2_msgs_here")
        yield side
        side.close()


@pytest.fixture(scope="module")
def peer(here):
    environment = {**os.environ, "ROS_DOMAIN_ID": str(here.domain)}
    with subprocess.Popen([sys.executable, __file__], stdin=subprocess.PIPE, env=environment) as process:
        try:
            yield process
            process.stdin.close()
            assert process.wait(DEADLINE_S) == 0
        finally:
            process.kill()


def test_transforms_arrive_from_another_process(here, peer):
    received = []
    subscription = here.node.create_subscription(TFMessage, "peer_tf", received.append, LATCHED)
    here.wait_until(lambda: received, "the peer's transforms")
    assert received[0] == TFMessage(transforms=[make_transform("map", "odom")])
    here.node.destroy_subscription(subscription)


@pytest.mark.parametrize(("topic", "name"), [("peer_tf", "msg/TFMessage"), ("peer_error", "msg/TF2Error")])
def test_type_hash_on_the_wire_is_that_of_ros(here, peer, topic, name):
    here.wait_until(lambda: here.node.count_publishers(topic), f"a publisher of {topic}")
    [endpoint] = here.node.get_publishers_info_by_topic(topic)
    assert str(endpoint.topic_type_hash) == TYPE_HASHES[name]


def test_frame_graph_is_answered_by_another_process(here, peer):
    client = here.node.create_client(FrameGraph, "peer_frames")
    here.wait_until(client.service_is_ready, "the peer's service")
    answer = here.result_of(client.call_async(FrameGraph.Request()), "the answer")
    assert answer.frame_yaml == "odom: {parent: map}"
    here.node.destroy_client(client)


def test_lookup_transform_is_acted_on_by_another_process(here, peer):
    client = ActionClient(here.node, LookupTransform, "peer_lookup")
    here.wait_until(client.server_is_ready, "the peer's action")
    goal = LookupTransform.Goal(target_frame="map", source_frame="odom", advanced=True)
    goal.timeout = Duration(sec=1)
    handle = here.result_of(client.send_goal_async(goal), "the goal's acceptance")
    assert handle.accepted
    answer = here.result_of(handle.get_result_async(), "the result")
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.transform == make_transform("map", "odom")
    assert answer.result.error == TF2Error(error=TF2Error.TIMEOUT_ERROR, error_string="True 1")
    client.destroy()


def serve():
    side = Here("tf2_msgs_peer")

    def answer_frames(_request, response):
        response.frame_yaml = "odom: {parent: map}"
        return response

    def act(handle):
        goal = handle.request
        handle.succeed()
        return LookupTransform.Result(
            transform=make_transform(goal.target_frame, goal.source_frame),
            error=TF2Error(error=TF2Error.TIMEOUT_ERROR, error_string=f"{goal.advanced} {goal.timeout.sec}"),
        )

    transforms = side.node.create_publisher(TFMessage, "peer_tf", LATCHED)
    side.node.create_publisher(TF2Error, "peer_error", LATCHED)
    side.node.create_service(FrameGraph, "peer_frames", answer_frames)
    action = ActionServer(side.node, LookupTransform, "peer_lookup", act)
    transforms.publish(TFMessage(transforms=[make_transform("map", "odom")]))

    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.is_set():
        side.executor.spin_once(timeout_sec=0.05)
    action.destroy()
    side.close()


if __name__ == "__main__":
    serve()
