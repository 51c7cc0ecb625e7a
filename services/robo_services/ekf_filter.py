"""Tells where a base is by all that measures it: wheels, and the gyro that knows when they slip."""

import math
from collections import Counter
from collections.abc import Set
from functools import partial
from typing import Annotated

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, ContractError, Health, MessageInfo, Node, Publisher, Unit, check, service, timer
from robo.tf import Transform3, TransformBroadcaster
from robo_messages import (
    Header,
    Imu,
    Odometry,
    PoseWithCovarianceStamped,
    Time,
    Trigger,
    TwistWithCovarianceStamped,
)
from robo_services.arrivals import Arrivals, Unstamped
from robo_services.ekf import AX, QUANTITIES, VX, Estimate, Measurement, Unusable, begin
from robo_services.ekf import check as check_measured
from robo_services.ekf_history import Ekf
from robo_services.ekf_messages import odometry_of, placed
from robo_services.ekf_parameters import (
    ANYWHERE,
    INITIAL,
    PROCESS_NOISE,
    SourceParameters,
    diagonal,
)
from robo_services.ekf_sources import Measured, Reader
from robo_services.ekf_watch import Source, Watch
from robo_services.kinematics import Pose2

TYPES: dict[str, type[Measured]] = {
    "odometry": Odometry,
    "imu": Imu,
    "pose": PoseWithCovarianceStamped,
    "twist": TwistWithCovarianceStamped,
}
Variances = Annotated[list[float], Meta(max_length=225), READ_ONLY]

AHEAD = 0.5
"""A stamp that is so far ahead of this node's clock, s, is of a clock that is not set."""
BEHIND = 1.0
"""A stamp that is by so much further behind it than the history is long, s, likewise."""
SETTLING = 2.0
"""For so long after the start it is no news that nothing has come yet, s."""
MOST_WAITING = 2000
"""Measurements that wait for the next tick."""


class EkfFilter(Node):
    """Fuse odometry, IMUs and poses into one odometry, by an extended Kalman filter in the plane.

    What robot_localization's ekf_node is with `two_d_mode`. Measurements are taken in the order of their stamps, late
    ones too. Where nobody says any more how far the base drives, or how it turns, or nobody is believed, the filter is
    silent: it does not guess. Then it goes on from where it was, less sure.
    """

    class Parameters(robo.Parameters):
        """Who measures what, and how sure the rest is."""

        sources: dict[str, SourceParameters] = msgspec.field(default_factory=dict)
        frequency: Annotated[
            float,
            Meta(ge=1, le=1000, description="how often measurements are taken and the result told"),
            Unit("Hz"),
        ] = 30.0
        sensor_timeout: Annotated[
            float, Meta(ge=0.01, le=60, description="a source that has been silent for so long says nothing"), Unit("s")
        ] = 0.25
        history_length: Annotated[
            float, Meta(ge=0, le=2, description="how much older than the newest a measurement may come"), Unit("s")
        ] = 0.3
        holonomic: Annotated[
            bool, Meta(description="the base can drive sideways; else it is taken not to"), READ_ONLY
        ] = False
        process_noise_covariance: Annotated[
            Variances, Meta(description="what a second adds to the variance of x, y, yaw, vx, vy, vyaw, ax, ay")
        ] = msgspec.field(default_factory=list)
        initial_estimate_covariance: Annotated[
            Variances, Meta(description="the variances at the start, in the same order")
        ] = msgspec.field(default_factory=list)
        publish_tf: Annotated[bool, Meta(description="whether tf says where the base stands in odom")] = True
        reset_on_time_jump: Annotated[
            bool, Meta(description="where time steps back it begins at the origin; else where it was")
        ] = False
        odom_frame: Annotated[str, Meta(min_length=1, description="the frame of poses"), READ_ONLY] = "odom"
        base_link_frame: Annotated[str, Meta(min_length=1, description="the frame of velocities"), READ_ONLY] = (
            "base_link"
        )
        unstamped: Unstamped = True

        def __post_init__(self) -> None:
            """Refuse lists that are no variances of eight quantities."""
            for name in ("process_noise_covariance", "initial_estimate_covariance"):
                try:
                    diagonal(getattr(self, name), PROCESS_NOISE)
                except ValueError as error:
                    raise ValueError(f"{name}: {error}") from None

    parameters: Parameters

    filtered = Publisher(Odometry, "odometry/filtered")
    """Where the base is and how it moves, as of the newest measurement."""
    frames = TransformBroadcaster()

    def on_start(self) -> None:
        """Nothing was measured yet."""
        p = self.parameters
        self._wall = self.clock.wall
        self._arrivals = Arrivals(unstamped=p.unstamped)
        self._readers = {name: Reader(name, said, holonomic=p.holonomic) for name, said in p.sources.items()}
        asked = {name: Source(self.resolve(said.topic), frozenset(said.use)) for name, said in p.sources.items()}
        self._watch = Watch(asked)
        self._origin = self.now()
        """What times of the filter count from: s since the epoch would cost it digits."""
        self._waiting: list[Measurement] = []
        self._before: Counter[str] = Counter()
        self._hindrance, self._begin = "", self._wall.monotonic()
        self._is_lost, self._is_doubted = True, False
        """Whether nobody is heard who says how the base moves, and whether nobody is believed."""
        self._is_slow = False
        """Whether the last tick took longer than its period."""
        self._ekf = filter_of(p)
        for name, said in p.sources.items():
            if self.resolve(said.topic) == self.resolve("odometry/filtered"):
                raise ContractError(f"{self.full_name}: sources.{name}.topic is what it publishes itself: {said.topic}")
            self.create_subscription(TYPES[said.type], said.topic, partial(self.on_measured, name), depth=50)
        # Not declared: nobody has to publish it, and a manifest is not to promise that somebody does.
        self.create_subscription(PoseWithCovarianceStamped, "set_pose", self.on_pose)
        if not p.sources:
            self.logger.warning("nothing is measured: name sources in the parameter sources (docs/localization.md)")

    def on_parameters_changed(self, names: Set[str]) -> None:
        """What is said of a source holds at once."""
        del names
        for name, reader in self._readers.items():
            reader.said = self.parameters.sources[name]

    def on_measured(self, name: str, message: Measured, info: MessageInfo) -> None:
        """Keep what a source measured for the next tick; what makes no sense counts as silence."""
        now = self.clock.monotonic()
        try:
            found = self._read(name, message, info)
            for one in found:
                if not one.assumed:
                    check_measured(one)
        except Unusable as error:
            self._ekf.refuse(name, error)
            self._complain(name)
            return
        self._watch.hear(name, found, self._arrivals.sent(info, now, self._wall.monotonic()), now)
        if found and (motion := self._readers[name].motion(message)) is not None:
            for other in self._readers.values():
                other.bias.wheels(*motion, found[0].time)
        self._waiting += found
        del self._waiting[:-MOST_WAITING]

    def _complain(self, name: str) -> None:
        why, count = self._ekf.complaints[name], self._ekf.left_out[name]
        self.logger.warning("left out what %s says: %s; %d times so far", name, why, count, throttle=5.0)

    def _read(self, name: str, message: Measured, info: MessageInfo) -> list[Measurement]:
        """What a message measures; raises Unusable."""
        p, reader = self.parameters, self._readers[name]
        time = self._time_of(message.header.stamp, info)
        if isinstance(message, Imu):
            return reader.imu(message, time)
        frame = message.header.frame_id
        if isinstance(message, TwistWithCovarianceStamped):
            _refuse_other(frame, p.base_link_frame)
            return reader.twist(message.twist, time)
        if any(map(reader.said.is_absolute, ("x", "y", "yaw"))):
            _refuse_other(frame, p.odom_frame)
        if isinstance(message, PoseWithCovarianceStamped):
            return reader.pose(message.pose, time)
        _refuse_other(message.child_frame_id, p.base_link_frame)
        return reader.odometry(message, time)

    def _time_of(self, stamp: Time, info: MessageInfo) -> float:
        """When that was, s since this node began; without a stamp when it was sent."""
        now = self._since_begin(self.now())
        sent = now - info.age if info.age < math.inf else now
        time = sent if stamp == Time() else self._since_begin(stamp)
        if time > now + AHEAD:
            raise Unusable(f"its stamp is {time - now:.3g} s ahead of the clock here")
        if time < now - self.parameters.history_length - BEHIND:
            raise Unusable(f"its stamp is {now - time:.3g} s behind the clock here")
        return time

    def _since_begin(self, stamp: Time) -> float:
        return (stamp.to_nanoseconds() - self._origin.to_nanoseconds()) * 1e-9

    @timer(rate="frequency")
    def fuse(self) -> None:
        """Take what was measured since the last tick, in the order of its stamps, and tell what is known now."""
        p, now, begun = self.parameters, self.clock.monotonic(), self._wall.monotonic()
        if not p.use_sim_time:
            self._arrivals.tick(begun, 1.0 / p.frequency)
        here = self._since_begin(self.now())
        if self._ekf.now.time > here + AHEAD:
            self._step_back()
        waiting, self._waiting = self._waiting, []
        if hindrance := self._watch.unheard(now, p.sensor_timeout):
            self._is_lost = True
            self._say(hindrance)
        elif waiting:
            self._take(waiting, now, here)
        self._is_slow = (took := self._wall.monotonic() - begun) > 1.0 / p.frequency
        if self._is_slow:
            text = "a tick took %.3g s, longer than its period: what comes late is left out of the next one"
            self.logger.warning(text, took, throttle=5.0)

    def _take(self, waiting: list[Measurement], now: float, here: float) -> None:
        """Take measurements, and tell what is known now, unless those of them that matter are not believed."""
        p, ekf, watch = self.parameters, self._ekf, self._watch
        if self._is_lost:
            ekf.lose(min((one.time for one in waiting if one.time > ekf.now.time), default=-math.inf))
            watch.trust(now)
            self._is_lost = False
        before, left_out = ekf.now.time, ekf.left_out
        ekf.history, ekf.longest_step = p.history_length, p.sensor_timeout
        watch.believe(ekf.take(waiting, replay=not self._is_slow), now)
        for name in ekf.left_out - left_out:
            self._complain(name)
        hindrance, was_doubted = watch.doubted(now, p.sensor_timeout), self._is_doubted
        self._is_doubted = bool(hindrance)
        self._say(hindrance)
        if hindrance and not was_doubted:
            ekf.lose()
        if not hindrance and (ekf.now.time > before or math.isnan(before)):
            self._tell(ekf.now, here)

    def _say(self, hindrance: str) -> None:
        has_begun = not math.isnan(self._ekf.now.time) or self._wall.monotonic() - self._begin >= SETTLING
        if hindrance == self._hindrance or (hindrance and not has_begun):
            return
        self._hindrance = hindrance
        if hindrance:
            self.logger.warning("silent: %s", hindrance)
        else:
            self.logger.info("goes on: all that it takes is heard")

    def _step_back(self) -> None:
        """Time has stepped back: what was is after what comes."""
        p = self.parameters
        what = "at the origin" if p.reset_on_time_jump else "where it was"
        self.logger.warning("time has stepped back: it begins anew %s", what, throttle=5.0)
        estimate = filter_of(p).now if p.reset_on_time_jump else self._ekf.now
        self._begin_anew(estimate._replace(time=math.nan))

    def _begin_anew(self, estimate: Estimate) -> None:
        self._ekf.begin_anew(estimate)
        self._waiting.clear()
        for reader in self._readers.values():
            reader.begin_anew(Pose2(*estimate.mean[:VX]))

    def _tell(self, known: Estimate, here: float) -> None:
        p = self.parameters
        stamp = Time.from_nanoseconds(self._origin.to_nanoseconds() + round(known.time * 1e9))
        odometry = odometry_of(known, Header(stamp, p.odom_frame), p.base_link_frame)
        self.filtered.publish(odometry, max(0.0, here - known.time))
        if p.publish_tf:
            stands = Transform3.from_message(odometry.pose.pose)
            self.frames.send(stands.to_stamped(odometry.header, p.base_link_frame))

    def on_pose(self, said: PoseWithCovarianceStamped) -> None:
        """Begin anew from a pose."""
        try:
            _refuse_other(said.header.frame_id, self.parameters.odom_frame)
            there = placed(self._ekf.now, said.pose, self._ekf.unsure)
        except Unusable as error:
            self.logger.warning("the pose is not taken: %s", error)
            return
        self._begin_anew(there)

    @service("reset")
    def reset(self, _request: Trigger.Request) -> Trigger.Response:
        """Begin anew at the origin."""
        self._begin_anew(filter_of(self.parameters).now)
        return Trigger.Response(message="back at the origin")

    @check("sources")
    def sources_are_heard(self) -> Health:
        """Whether all that is to be fused comes, and is believed."""
        p, now, ekf = self.parameters, self.clock.monotonic(), self._ekf
        gyros = {name: one.bias for name, one in self._readers.items() if one.said.type == "imu"}
        figures = {**_counted(ekf), **{f"bias.{name}": bias.bias for name, bias in gyros.items()}}
        left_out, self._before = ekf.left_out - self._before, ekf.left_out
        reasons = "; ".join(f"{name}: {ekf.complaints[name]}" for name in left_out)
        doubted = self._watch.doubted(now, p.sensor_timeout) if self._is_doubted else ""
        if hindrance := self._watch.unheard(now, p.sensor_timeout) or doubted:
            return Health.error(f"silent: {hindrance}" + (f" ({reasons})" if reasons else ""), **figures)
        if silent := self._watch.silent(now, p.sensor_timeout):
            return Health.warn(f"nothing new of {', '.join(silent)}", **figures)
        if reasons:
            return Health.warn(f"left out: {reasons}", **figures)
        if biased := [f"{name} says {bias.excess:.3g} rad/s" for name, bias in gyros.items() if bias.excess]:
            return Health.warn(f"{', '.join(biased)} while the wheels stand: more than rest_bias", **figures)
        return Health.ok(**figures)


def filter_of(p: EkfFilter.Parameters) -> Ekf:
    """One that knows nothing yet but what its parameters say."""
    accelerates = any({"ax", "ay"} & {*said.use} for said in p.sources.values())
    size = AX + 2 if accelerates else AX
    variances = list(diagonal(p.initial_estimate_covariance, INITIAL))
    if not p.initial_estimate_covariance:
        for i, variance in enumerate(ANYWHERE):
            if any(said.is_absolute(QUANTITIES[i]) for said in p.sources.values()):
                variances[i] = variance
    noise = diagonal(p.process_noise_covariance, PROCESS_NOISE)
    return Ekf(begin(variances[:size]), noise, history=p.history_length, longest_step=p.sensor_timeout)


def _counted(ekf: Ekf) -> dict[str, int]:
    return {
        "late": ekf.late.total(),
        "refused": ekf.refused.total(),
        "rejected": ekf.rejected.total(),
        "replayed": ekf.replayed,
    }


def _refuse_other(frame: str, wanted: str) -> None:
    if frame.removeprefix("/") not in ("", wanted):
        raise Unusable(f"it is in the frame {frame}, not in {wanted}")


if __name__ == "__main__":
    robo.run(EkfFilter)
