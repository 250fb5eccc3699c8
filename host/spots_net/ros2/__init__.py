"""ROS 2, without an installation of ROS."""
