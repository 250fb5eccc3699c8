"""Packages for ROS 2, which are optional: without them, this import raises SpotsError."""

from spots.errors import missing

try:
    from mcap import writer as mcap_writer
    from rosbags import typesys as typesys
except ImportError:
    raise missing("messages for ROS 2 need", "rosbags and mcap", "ros2") from None

Writer = mcap_writer.Writer
