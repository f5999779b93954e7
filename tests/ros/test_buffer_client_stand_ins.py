"""A buffer client in unit tests of programs, which put their own action client in the place of rclpy's."""

import asyncio
from unittest import mock

import pytest
from making import at
from making import transform as transform_message
from rclpy.duration import Duration
from rclpy.task import Future

from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error


@pytest.fixture
def transform():
    return transform_message("map", "robot", 1.5, (1, 2, 3))


@pytest.fixture
def stand_in(transform):
    """An action client whose server answers at once."""
    stand_in = mock.MagicMock()
    stand_in.server_is_ready.return_value = True
    accepted = Future()
    accepted.set_result(mock.MagicMock(accepted=True))
    stand_in.send_goal_async.return_value = accepted
    stand_in._get_result.return_value.result = LookupTransform.Result(transform=transform)
    return stand_in


@pytest.fixture
def client(tf2_ros, stand_in):
    with mock.patch("tf2_ros.buffer_client.ActionClient", return_value=stand_in) as cls:
        node = mock.MagicMock()
        client = tf2_ros.BufferClient(node, "lookup")
    cls.assert_called_once_with(node, LookupTransform, action_name="lookup")
    assert client.action_client is stand_in
    yield client
    client.destroy()
    stand_in.destroy.assert_called_once_with()


def test_it_gets_the_goal_and_its_result_is_returned(client, stand_in, transform):
    assert client.lookup_transform("map", "robot", at(1.5), Duration(seconds=3)) == transform
    (goal,) = stand_in.send_goal_async.call_args.args
    assert (goal.target_frame, goal.source_frame, goal.advanced) == ("map", "robot", False)
    assert (goal.source_time, goal.timeout) == (at(1.5).to_msg(), Duration(seconds=3).to_msg())
    assert client.lookup_transform_full("map", at(2), "robot", at(1), "odom") == transform
    (goal,) = stand_in.send_goal_async.call_args.args
    assert (goal.fixed_frame, goal.target_time, goal.advanced) == ("odom", at(2).to_msg(), True)
    assert client.can_transform("map", "robot", at(1))


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (TF2Error.LOOKUP_ERROR, "LookupException"),
        (TF2Error.EXTRAPOLATION_ERROR, "ExtrapolationException"),
        (TF2Error.TRANSFORM_ERROR, "TransformException"),
    ],
)
def test_its_errors_are_raised(tf2_ros, client, stand_in, code, name):
    stand_in._get_result.return_value.result.error = TF2Error(error=code, error_string="so it is")
    with pytest.raises(getattr(tf2_ros, name), match="so it is"):
        client.lookup_transform("map", "robot", at(1))
    assert not client.can_transform("map", "robot", at(1))


def test_what_does_not_print_in_its_errors_is_escaped(tf2_ros, client, stand_in):
    error = TF2Error(error=TF2Error.LOOKUP_ERROR, error_string="no frame \x1b[31m\n")
    stand_in._get_result.return_value.result.error = error
    with pytest.raises(tf2_ros.LookupException) as caught:
        client.lookup_transform("map", "robot", at(1))
    assert str(caught.value) == r"no frame \x1b[31m\n"


def test_without_a_server_it_is_a_timeout(tf2_ros, client, stand_in):
    stand_in.server_is_ready.return_value = False
    with pytest.raises(tf2_ros.TimeoutException):
        client.lookup_transform("map", "robot", at(1))


def test_a_goal_that_is_never_accepted_is_a_timeout(tf2_ros, client, stand_in):
    client.timeout_padding = Duration(seconds=0.1)
    stand_in.send_goal_async.return_value = Future()
    with pytest.raises(tf2_ros.TimeoutException, match=r"did not answer in time\. Waited 0\.1 s$"):
        client.lookup_transform("map", "robot", at(1))
    refused = Future()
    refused.set_result(mock.MagicMock(accepted=False))
    stand_in.send_goal_async.return_value = refused
    with pytest.raises(tf2_ros.TimeoutException):
        client.lookup_transform("map", "robot", at(1))


def test_one_that_is_put_into_the_attribute_is_used(tf2_ros, stand_in, transform, node):
    client = tf2_ros.BufferClient(node, "lookup")
    own = client.action_client
    client.action_client = stand_in
    assert client.lookup_transform("map", "robot", at(1)) == transform
    client.action_client = own
    client.destroy()


def test_the_steps_of_a_lookup_can_be_patched(tf2_ros, client, stand_in):
    with mock.patch.object(tf2_ros.BufferClient, "_BufferClient__process_goal", return_value="answer"):
        assert client.lookup_transform("map", "robot", at(1)) == "answer"
    with mock.patch.object(tf2_ros.BufferClient, "_BufferClient__process_result", return_value="answer"):
        assert client.lookup_transform("map", "robot", at(1)) == "answer"


@pytest.mark.ours
def test_it_can_be_awaited(client, transform):
    assert asyncio.run(client.lookup_transform_async("map", "robot", at(1))) == transform
