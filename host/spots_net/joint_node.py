"""Publishes the angles of joints as a node of ROS 2, over Zenoh as ``spots publish`` does."""

from contextlib import ExitStack

import numpy as np

from .ros2.messages import POINT, header
from .ros2.naming import DEFAULT_QOS, ros_domain
from .ros2.types import packed, store, topic
from .ros_node import RosNode
from .zenoh_session import open_session

_JOINT_STATE = "sensor_msgs/msg/JointState"


class JointNode:
    """A node with the topics ``/NAME/joint_states`` and ``/NAME/end_point``.

    ``sensor_msgs/JointState`` has the angles in rad, and ``geometry_msgs/PointStamped`` the end
    point of a linkage in m, while there is one. The ROS domain is ROS_DOMAIN_ID, or 0. SettingError
    if it is wrong, RequirementError if Zenoh does not start.
    """

    def __init__(self, name: str = "spots_twin"):
        self._frame_id = f"{name}_base"
        with ExitStack() as own:
            session = own.enter_context(open_session())
            node = RosNode(session, ros_domain(), name)
            own.callback(node.close)
            joints = topic(f"/{name}/joint_states", _JOINT_STATE)
            self._joints = node.publisher(joints, DEFAULT_QOS)
            self._point = node.publisher(topic(f"/{name}/end_point", POINT), DEFAULT_QOS)
            self.close = own.pop_all().close

    def put_angles(self, angles_rad: dict[str, float], utc_s: float) -> None:
        """Publish angles by the joints' names, measured at `utc_s` (seconds since 1970)."""
        if self._joints.wanted:
            made = store().types
            angles, unknown = np.array([*angles_rad.values()]), np.array([])
            message = made[_JOINT_STATE](header(utc_s, ""), [*angles_rad], angles, unknown, unknown)
            self._joints.put(packed(message), round(1e9 * utc_s))

    def put_point(self, x_mm: float, y_mm: float, utc_s: float) -> None:
        """Publish the end point of a linkage, measured at `utc_s` (seconds since 1970)."""
        if self._point.wanted:
            made = store().types
            place = made["geometry_msgs/msg/Point"](x_mm / 1e3, y_mm / 1e3, 0.0)
            message = made[POINT](header(utc_s, self._frame_id), place)
            self._point.put(packed(message), round(1e9 * utc_s))
