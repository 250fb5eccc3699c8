"""The package rosbags, which is optional: without it, this import raises SpotsError."""

from spots.errors import missing

try:
    from rosbags import typesys as typesys
except ImportError:
    raise missing("messages for ROS 2 need", "rosbags", "zenoh") from None
