"""The engine on C structs: no Python objects, no ROS."""
