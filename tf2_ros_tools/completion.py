"""Complete the names of frames in a shell that completes command lines with argcomplete."""

from argparse import Action, ArgumentParser, Namespace
from typing import Any

from tf2_ros_tools.program import arguments_for_ros

# Fast DDS may find some of the publishers at once, and the others when it repeats its messages, after 3 s.
LISTEN_S = 4.0


def add_frames(parser: ArgumentParser, *names: str, **settings: Any) -> Action:
    """Add an argument for frames, as ``add_argument`` does."""
    action = parser.add_argument(*names, **settings)
    complete_frames(action)
    return action


def complete_frames(*actions: Action) -> None:
    """Let arguments, which are for frames, complete the names of those that are published."""
    for action in actions:
        action.completer = _frames  # type: ignore[attr-defined]


def _frames(parsed_args: Namespace, **_: object) -> list[str]:
    """List the frames that are published while the shell waits."""
    from tf2_ros_tools.listening import listening, spun_node

    options = Namespace(ros_arguments=arguments_for_ros(parsed_args))
    with spun_node("_completion", options) as node, listening(node) as heard:
        heard.listen(LISTEN_S)
        return sorted(heard.buffer.frames())
