# A script in the style of a notebook: the listener spins its own thread, the main program just asks.

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration

import tf2_ros

rclpy.init()
listening = rclpy.create_node("notebook")
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer, listening, spin_thread=True)

talking = rclpy.create_node("talker")
static = tf2_ros.StaticTransformBroadcaster(talking)

mount = TransformStamped()
mount.header.frame_id = "chassis"
mount.child_frame_id = "laser"
mount.transform.translation.x = 0.2
mount.transform.translation.z = 0.4
mount.transform.rotation.z = 1.0
mount.transform.rotation.w = 0.0
static.sendTransform(mount)

# %% ask
ok = buffer.can_transform("chassis", "laser", rclpy.time.Time(), timeout=Duration(seconds=60))
print("can transform:", bool(ok))
t = buffer.lookup_transform("chassis", "laser", rclpy.time.Time())
print(t.header.frame_id, t.child_frame_id, t.transform.translation.x, t.transform.translation.z)
t = buffer.lookup_transform("laser", "chassis", rclpy.time.Time(), Duration(seconds=1))
print(f"{t.transform.translation.x:.2f} {t.transform.translation.y:.2f} {t.transform.translation.z:.2f}")

# %% things that move
moving = tf2_ros.TransformBroadcaster(talking)
t = TransformStamped()
t.header.frame_id, t.child_frame_id = "odom", "chassis"
t.transform.rotation.w = 1.0
for _ in range(1200):
    # The listener may be discovered late, so until somebody has it.
    t.header.stamp = talking.get_clock().now().to_msg()
    t.transform.translation.x = 5.0
    moving.sendTransform(t)
    if buffer.can_transform("odom", "laser", rclpy.time.Time(), timeout=Duration(seconds=0.05)):
        break
print(round(buffer.lookup_transform("odom", "laser", rclpy.time.Time()).transform.translation.x, 3))
try:
    buffer.lookup_transform("odom", "kitchen", rclpy.time.Time(), timeout=Duration(seconds=0.1))
except tf2_ros.LookupException:
    print("no kitchen")

# %% the end: the thread of the listener ends first
print("spins in a thread:", listener.dedicated_listener_thread.is_alive())
listener.executor.shutdown()
listener.dedicated_listener_thread.join(60)
print("still spins:", listener.dedicated_listener_thread.is_alive())
talking.destroy_node()
listening.destroy_node()
rclpy.shutdown()
