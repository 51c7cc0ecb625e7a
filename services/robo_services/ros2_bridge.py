"""The bridge to ROS 2, as a node of the robot: what the manifest's key `bridges` starts."""

from typing import TYPE_CHECKING, Annotated, Any

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, Health, Node, Publisher, check, timer
from robo.errors import ParameterError
from robo.text.readable import readable
from robo_messages import DiagnosticStatus, KeyValue

if TYPE_CHECKING:
    import zenoh

    from robo.bridges.ros2.bridge import Bridge, Status

_MOST_TOLD = 100
"""Topics that are told of in the state."""


class Ros2Bridge(Node):
    """Let ROS 2 see the robot, and the robot what its manifest takes from ROS, over the wire of rmw_zenoh."""

    class Parameters(robo.Parameters):
        """What crosses."""

        settings: Annotated[
            str, Meta(description="what the manifest says below bridges: ros2, as JSON"), READ_ONLY
        ] = "{}"  # fmt: skip

    parameters: Parameters

    state = Publisher(DiagnosticStatus, "ros2_bridge_state", latched=True)
    """What has crossed, what was lost and what does not fit, in all and by topic: once a second."""

    _bridge: "Bridge | None" = None
    _ros: "zenoh.Session | None" = None
    _seen: "Status | None" = None

    @classmethod
    def lacking(cls, parameters: Any) -> Any:
        """The library that makes ids."""
        from importlib.util import find_spec

        found = [*super().lacking(parameters)]
        if find_spec("xxhash") is None:
            found.append("needs the library xxhash: pip install 'robo-zenoh[ros2]'")
        return found

    def on_start(self) -> None:
        """Join ROS's network; its router may come later."""
        # Here, since it brings along what no other node needs.
        from robo.bridges.ros2.bridge import Bridge
        from robo.bridges.ros2.claim import give_way
        from robo.bridges.ros2.networks import join_ros
        from robo.launch.plan import Ros2Plan
        from robo.wire.session import close_session

        try:
            plan = msgspec.json.decode(self.parameters.settings, type=readable(Ros2Plan))
        except msgspec.DecodeError as error:
            raise ParameterError(f"settings: {error}") from None
        give_way(self.session, self.full_name)
        self._ros = join_ros(plan.connect, patient=True)
        try:
            self._bridge = Bridge(
                self.session, self._ros, plan, self.namespace, self.logger.warning, node=self.full_name
            )
        except BaseException:
            close_session(self._ros)
            raise
        self._tell()

    def on_stop(self) -> None:
        """Leave ROS's network."""
        from robo.wire.session import close_session

        if self._bridge is not None:
            self._bridge.close()
        if self._ros is not None:
            close_session(self._ros)

    @timer(rate=1.0, turn="state")
    def watch(self) -> None:
        """Tell how it goes."""
        self._tell()

    @check("bridge")
    def it_connects(self) -> Health:
        """Whether ROS's network is there, and all that is to cross fits."""
        status = self._seen
        if status is None:
            return Health.ok("it begins")
        if not status.ros_is_there:
            return Health.error("ROS's router does not answer; it is dialled until it does")
        if status.faults:
            return Health.warn(f"{len(status.faults)} do not cross: {status.faults[0]}")
        return Health.ok(f"{sum(one.crossed for one in status.topics)} messages have crossed")

    def _tell(self) -> None:
        if self._bridge is None:
            return
        status = self._seen = self._bridge.status()
        values = [
            KeyValue("domain", str(status.domain)),
            KeyValue("nodes", str(status.ros_nodes)),
            KeyValue("faults", "; ".join(status.faults[:10])),
        ]
        for one in status.topics[:_MOST_TOLD]:
            told = f"{one.crossed} crossed, {one.rate:.1f}/s, {one.dropped} lost, {one.refused} refused"
            values.append(KeyValue(f"{one.way} {one.key}", told))
        level = DiagnosticStatus.OK
        if status.faults or not status.ros_is_there:
            level = DiagnosticStatus.WARN if status.ros_is_there else DiagnosticStatus.ERROR
        message = "connected" if status.ros_is_there else "ROS's router does not answer"
        self.state.publish(DiagnosticStatus(level, self.full_name, message, "", values))


if __name__ == "__main__":
    robo.run(Ros2Bridge)
