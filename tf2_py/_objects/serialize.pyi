from geometry_msgs.msg import TransformStamped

def serialize_transforms(
    transforms: list[TransformStamped],
) -> tuple[bytes, list[tuple[str, str]]] | None: ...
