"""Says where the parts of a robot stand, from its URDF and the positions of its joints."""

from typing import Annotated

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, Node, ParameterError, Publisher, Unit, subscribe, timer
from robo.errors import InvalidTransform
from robo.tf import StaticTransformBroadcaster, Transform3, TransformBroadcaster
from robo_messages import Header, JointState, String, Time, TransformStamped
from robo_services import urdf_files, urdf_model
from robo_services.robot_state import RobotState, no_positions, positions_of
from robo_services.urdf_model import listed
from robo_services.urdf_xml import Joint


class RobotStatePublisher(Node):
    """Publish the frames of a URDF: fixed ones once, those that move whenever positions of their joints come.

    With mistakes in the URDF it does not start, and names all of them. A frame whose joint was never heard of does
    not exist; the log says which.
    """

    class Parameters(robo.Parameters):
        """Which robot, and how often."""

        urdf: Annotated[
            str, Meta(description="the file that describes the robot; xacro makes it of one named .xacro"), READ_ONLY
        ] = ""
        robot_description: Annotated[str, Meta(description="its text, in place of a file"), READ_ONLY] = ""
        xacro_arguments: Annotated[
            list[str], Meta(description="what a file for xacro is told, name:=value each"), READ_ONLY
        ] = msgspec.field(default_factory=list)
        frame_prefix: Annotated[
            str, Meta(description="what the names of all frames begin with, r1/ for example"), READ_ONLY
        ] = ""
        publish_frequency: Annotated[
            float, Meta(gt=0, le=1000, description="a joint's frame is published no more often"), Unit("Hz")
        ] = 20.0
        ignore_timestamp: Annotated[
            bool, Meta(description="publish for each message that comes, however soon after the last one")
        ] = False

    parameters: Parameters

    frames = TransformBroadcaster()
    fixed_frames = StaticTransformBroadcaster()
    description = Publisher(String, "robot_description", latched=True)
    """The URDF, for viewers and planners."""

    def on_start(self) -> None:
        """Read the URDF, and say what never changes."""
        text, source = self._text()
        self._model = urdf_model.parse(text, source)
        self._state = RobotState(self._model)
        self._missing: list[Joint] = []
        self._refused = 0
        for warning in self._model.warnings:
            self.logger.warning("%s", warning)
        self.description.publish(String(text))
        if self._model.fixed:
            now = self.now()
            self.fixed_frames.send(*(self._stamped(joint, joint.at(0.0), now) for joint in self._model.fixed))
        count, moving = len(self._model.links), len(self._model.moving)
        self.logger.info(
            "%s has %d links from %s on, %d joints move", self._model.name, count, self._model.root, moving
        )

    @subscribe("joint_states", depth=20)
    def on_joint_states(self, state: JointState) -> None:
        """Say where the links stand whose joints have moved."""
        try:
            told = positions_of(state)
        except ValueError as error:
            self._refused += 1
            text = "ignored a message on %s: %s; %d so far"
            self.logger.warning(text, self.resolve("joint_states"), error, self._refused, throttle=5.0)
            return
        wrong = no_positions(told)
        if wrong:
            self._refused += 1
            text = "left out positions that are NaN, infinite or absurd, of %s; %d messages so far"
            self.logger.warning(text, listed(wrong), self._refused, throttle=5.0)
        stamp = state.header.stamp
        if stamp == Time():
            text = "messages on %s have no time of measurement: that of their arrival is taken"
            self.logger.warning(text, self.resolve("joint_states"), throttle=60.0)
            stamp = self.now()
        p = self.parameters
        interval = 0 if p.ignore_timestamp else round(1e9 / p.publish_frequency)
        moving = self._model.moving
        transforms = self._state.take(told, stamp.to_nanoseconds(), interval)
        if transforms:
            self._send([self._stamped(moving[name], where, stamp) for name, where in transforms.items()])

    @timer(rate=0.2)
    def tell_missing(self) -> None:
        """Say which joints have not been heard of, whenever that has changed."""
        missing = self._state.missing
        if missing and missing != self._missing:
            topic, strangers = self.resolve("joint_states"), self._state.strangers
            others = f"; it tells of {listed(sorted(strangers))}, which the robot does not have" if strangers else ""
            text = "no position has come on %s of %s: there are no frames %s%s"
            joints, links = listed(joint.name for joint in missing), listed(joint.child for joint in missing)
            self.logger.warning(text, topic, joints, links, others)
        elif self._missing and not missing:
            self.logger.info("all joints have been heard of")
        self._missing = missing

    def _text(self) -> tuple[str, str]:
        """The URDF, and what it is called in messages."""
        p = self.parameters
        if bool(p.urdf) == bool(p.robot_description):
            what = (
                "both urdf and robot_description describe" if p.urdf else "neither urdf nor robot_description describes"
            )
            raise ParameterError(f"{self.full_name}: {what} the robot; give it one of them, -p urdf:=FILE for example")
        return urdf_files.load(p.urdf, p.xacro_arguments) if p.urdf else (p.robot_description, "robot_description")

    def _stamped(self, joint: Joint, where: Transform3, stamp: Time) -> TransformStamped:
        prefix = self.parameters.frame_prefix
        return where.to_stamped(Header(stamp, prefix + joint.parent), prefix + joint.child)

    def _send(self, transforms: list[TransformStamped]) -> None:
        try:
            self.frames.send(*transforms)
        except InvalidTransform as error:  # of an absurd stamp
            self.logger.warning("ignored a message on %s: %s", self.resolve("joint_states"), error, throttle=5.0)


if __name__ == "__main__":
    robo.run(RobotStatePublisher)
