"""Tells what a camera sees; or a video file, or a test picture, where there is none."""

import time
from typing import Annotated, ClassVar

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, Health, Node, ParameterError, Publisher, QoS, Unit, check
from robo_messages import CameraInfo, CompressedImage, Header, Image, Time
from robo_services import camera_info
from robo_services.camera_source import TEST, Picture, Source, SourceGone, Wanted, import_av, is_device
from robo_services.pictures import Encoding, Gaps, JpegEncoder, Pace, Rate, image_of, jpeg_image

RETRY = 1.0
"""How long it waits before it looks for a camera again, s."""

SILENT_AFTER = 2.0
"""A camera that says nothing for this long is silent, s."""

OLDEST = 10.0
"""A camera whose pictures are older goes by another clock, s."""

LEAST_RATE = 0.001
"""A picture in a quarter of an hour, Hz."""


class Camera(Node):
    """Publish the pictures of a camera, a video file or a test picture, plain or as JPEGs, as somebody listens to them.

    A camera that is not there, or is unplugged, is waited for. A file is played as fast as it was recorded; the node
    ends with it, or plays it again and again.
    """

    REQUIRES: ClassVar = {"av": "robo-zenoh[camera]"}

    class Parameters(robo.Parameters):
        """Where pictures come from, and what they are made into."""

        source: Annotated[
            str,
            Meta(min_length=1, description="a camera such as /dev/video0, a video file, or test: a picture that moves"),
            READ_ONLY,
        ] = TEST
        image_width: Annotated[
            int,
            Meta(ge=0, le=8192, description="what the camera is asked for, pixels; 0: as it likes; a file is as it is"),
            READ_ONLY,
        ] = 0
        image_height: Annotated[int, Meta(ge=0, le=8192, description="the same of its rows"), READ_ONLY] = 0
        framerate: Annotated[
            float,
            Meta(ge=0, le=1000, description="what the camera is asked for; 0: as it likes; a file is as it is"),
            Unit("Hz"),
            READ_ONLY,
        ] = 0.0
        pixel_format: Annotated[
            str,
            Meta(description="what the camera is asked for, such as mjpeg or yuyv422; empty: as it likes"),
            READ_ONLY,
        ] = ""
        encoding: Annotated[Encoding, Meta(description="of plain pictures")] = "rgb8"
        jpeg_quality: Annotated[
            int, Meta(ge=1, le=100, description="of JPEGs that it makes; those of a camera are passed on as they are")
        ] = 80
        frame_id: Annotated[
            str, Meta(min_length=1, description="the camera's frame: z into the picture, x right, y down"), READ_ONLY
        ] = "camera"
        camera_info_url: Annotated[
            str,
            Meta(
                description="its calibration, as ROS's camera_calibration writes it: a path or file:///…; empty: none"
            ),
            READ_ONLY,
        ] = ""
        loop: Annotated[bool, Meta(description="a file begins anew at its end")] = False
        playback_rate: Annotated[
            float, Meta(ge=0.001, le=100, description="a file: 1.0 as fast as it was recorded"), READ_ONLY
        ] = 1.0

        def __post_init__(self) -> None:
            """Refuse half a size, and a rate that no camera counts with."""
            if bool(self.image_width) != bool(self.image_height):
                raise ValueError("image_width and image_height are asked for together, or neither")
            if 0.0 < self.framerate < LEAST_RATE:
                raise ValueError(f"framerate is at least {LEAST_RATE:g} Hz, or 0")

    parameters: Parameters

    images = Publisher(Image, "image_raw", qos=QoS(priority="background"))
    """Plain pictures; made while somebody listens."""
    jpegs = Publisher(CompressedImage, "image_raw/compressed", qos=QoS(priority="background"))
    """JPEGs; made while somebody listens."""
    infos = Publisher(CameraInfo, "camera_info", latched=True)
    """The calibration, or the size of the pictures alone; with the first picture, and where the size changes."""

    def on_start(self) -> None:
        """Read the calibration; a file is opened, so that a wrong name is told at once."""
        av = import_av()  # what cannot work is said at once
        p = self.parameters
        self._encoder = JpegEncoder(av)
        self._calibration = camera_info.load(p.camera_info_url) if p.camera_info_url else None
        self._size = (0, 0)
        self._missed = ""
        """Why there is no camera."""
        self._first: Source | None = None
        self._came = Rate()
        self._wanted = 0.0
        """How many pictures a second the source says that there are; 0 where it does not."""
        self._count = self._lost = self._broken = self._slips = 0
        live = is_device(p.source)
        self._ticks = self.clock.wall if live else self.clock
        self._heard = self._started = self._ticks.monotonic()
        if not live:
            try:
                self._first = self._opened()
            except SourceGone as error:
                raise ParameterError(f"{self.full_name}: source {error}") from None

    def main(self) -> None:
        """Play the source, and look for it again when it is gone."""
        while not self.stopping:
            try:
                source, self._first = self._first or self._opened(), None
            except SourceGone as error:
                if str(error) != self._missed:  # once, however long it stays away
                    self._missed = str(error)
                    self.logger.warning("no camera: %s; it is waited for", error)
                self._pause(RETRY)
                continue
            self._begin(source)
            broken = self._broken
            try:
                self._play(source)
            except SourceGone as error:
                self.logger.warning("the source is gone: %s", error, throttle=5.0)
                self._missed = str(error) if source.is_live else ""
            finally:
                source.close()
                self._broken = broken + source.broken
            if source.is_live:
                self._pause(RETRY)
            elif not self._plays_again(source):
                break
        self.flush(timeout=10.0)
        self.logger.info("told %d pictures of %s", self._count, self.parameters.source)

    @check("pictures")
    def pictures_come(self) -> Health:
        """Whether pictures come, as fast as they should."""
        now, source = self._ticks.monotonic(), self.parameters.source
        rate = self._came.at(now)
        figures: dict[str, object] = {"rate": round(rate, 1), "pictures": self._count, "lost": self._lost}
        figures |= {"broken": self._broken, "held_up": self._slips}
        if self._missed:
            return Health.error(f"no camera: {self._missed}", **figures)
        if now - self._heard > max(SILENT_AFTER, 3.0 / self._wanted if self._wanted else 0.0):
            return Health.error(f"no picture comes from {source}", **figures)
        if now - self._started > 2 * Rate.OVER and rate < 0.8 * self._wanted - 1.0 / Rate.OVER:
            return Health.warn(f"{rate:.1f} of {self._wanted:.1f} pictures a second come", **figures)
        calibration = self._calibration
        if calibration is not None and any(self._size) and (calibration.width, calibration.height) != self._size:
            wanted_size = f"{calibration.width}x{calibration.height}"
            return Health.warn(f"pictures are {self._size[0]}x{self._size[1]}, calibrated is {wanted_size}", **figures)
        return Health.ok(**figures)

    def _opened(self) -> Source:
        p = self.parameters
        return Source(p.source, Wanted(p.image_width, p.image_height, p.framerate, p.pixel_format))

    def _plays_again(self, source: Source) -> bool:
        """Whether a file that has ended begins anew; the last picture is shown as long as the others."""
        if not self.parameters.loop or not self._count:
            return False
        return self.sleep(1.0 / (source.rate or 30.0) / self.parameters.playback_rate)

    def _begin(self, source: Source) -> None:
        self._missed, self._started = "", self._ticks.monotonic()
        self._heard = self._started
        self._wanted = source.rate * (1.0 if source.is_live else self.parameters.playback_rate)
        self._came.forget()
        if self._count and not source.is_live:
            return  # it begins anew
        rate = f"{source.rate:.4g} pictures a second" if source.rate else "a rate that it does not say"
        self.logger.info("plays %s, %s", source.place, rate)

    def _play(self, source: Source) -> None:
        """Publish the pictures of a source until its end.

        Raises:
            SourceGone: it was unplugged, or is broken.
        """
        pace = Pace(self.parameters.playback_rate, source.rate)
        broken, gaps = self._broken, Gaps()
        for index, picture in enumerate(source.pictures(lambda: self.images.has_subscribers, self._pause)):
            if source.is_live:
                self._count_lost(gaps.lost(picture.time))
            else:
                taken = picture.time if picture.time == picture.time else index / (source.rate or 30.0)
                slips = pace.slips
                self.sleep(pace.wait(taken, self.clock.monotonic()))
                self._slips += pace.slips - slips
            if self.stopping:
                return
            self._tell(picture, is_live=source.is_live)
            if broken + source.broken > self._broken:
                self._broken = broken + source.broken
                self.logger.warning("%d pictures could not be decoded so far", self._broken, throttle=5.0)

    def _count_lost(self, lost: int) -> None:
        if lost:
            self._lost += lost
            self.logger.warning("%d pictures were lost between camera and node so far", self._lost, throttle=5.0)

    def _pause(self, seconds: float) -> bool:
        """Wait for a device, by the wall's clock as it knows no other; False where it is time to stop."""
        return not self.wait(seconds)

    def _tell(self, picture: Picture, *, is_live: bool) -> None:
        p = self.parameters
        age = time.monotonic() - picture.time if is_live else 0.0  # by the kernel's clock, as picture.time is
        header = Header(_before(self.now(), age), p.frame_id)
        if (picture.width, picture.height) != self._size:
            self._size = picture.width, picture.height
            self._tell_info(header)
        if picture.frame is not None and self.images.has_subscribers:
            self.images.publish(image_of(picture.frame, p.encoding, header))
        if self.jpegs.has_subscribers:
            try:
                jpeg = picture.jpeg or self._encoder.encode(picture.frame, p.jpeg_quality)
                self.jpegs.publish(jpeg_image(jpeg, header))
            except ValueError as error:
                self.logger.warning("no JPEG could be made: %s", error, throttle=5.0)
        self._count += 1
        self._heard = self._ticks.monotonic()
        self._came.take(self._heard)

    def _tell_info(self, header: Header) -> None:
        width, height = self._size
        known = self._calibration
        if known is None:
            self.infos.publish(CameraInfo(header, height, width))
            return
        if (known.width, known.height) != self._size:
            self.logger.warning(
                "pictures are %dx%d and the calibration is for %dx%d", width, height, known.width, known.height
            )
        self.infos.publish(msgspec.structs.replace(known, header=header))

    def on_stop(self) -> None:
        """Close what was never played."""
        if self._first is not None:
            self._first.close()


def _before(now: Time, age: float) -> Time:
    """A while ago; now, where nobody knows how long ago."""
    return Time.from_nanoseconds(max(0, now.to_nanoseconds() - round(age * 1e9))) if 0.0 < age < OLDEST else now


if __name__ == "__main__":
    robo.run(Camera)
