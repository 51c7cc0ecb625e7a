"""Tells what a game pad says."""

import math
from typing import Annotated, Literal

from msgspec import Meta

import robo
from robo import READ_ONLY, Health, Node, Publisher, QoS, Unit, check
from robo_messages import Header, Time, sensor
from robo_services.joystick import Pad
from robo_services.joystick_device import Device, DeviceGone, import_evdev, open_device
from robo_services.waiting import Waiting

RETRY = 1.0
"""How long it waits before it looks for a pad again, s."""


class Joy(Node):
    """Publish what the axes and buttons of a game pad are at: on every change, and again while nothing changes.

    A pad that is not there is waited for, and said once; while it is not there nothing is published, so that whoever
    drives by it stops.
    """

    class Parameters(robo.Parameters):
        """Which pad, and how it is told; names are those of ROS's joy."""

        device: Annotated[str, Meta(description="its device, such as /dev/input/js0; empty: device_id"), READ_ONLY] = ""
        device_id: Annotated[int, Meta(ge=0, le=255, description="which of the pads that are there"), READ_ONLY] = 0
        device_name: Annotated[
            str, Meta(description="the pad's name; goes before device_id, and empty is any"), READ_ONLY
        ] = ""
        interface: Annotated[
            Literal["js", "evdev"],
            Meta(description="Linux's joystick API, or evdev, which needs the extra joy"),
            READ_ONLY,
        ] = "js"
        deadzone: Annotated[float, Meta(ge=0, le=0.9, description="an axis nearer to its middle is at 0")] = 0.05
        autorepeat_rate: Annotated[
            float, Meta(ge=0, le=1000, description="messages per second while nothing changes; 0 for none"), Unit("Hz")
        ] = 20.0
        coalesce_interval_ms: Annotated[
            int, Meta(ge=0, le=1000, description="axes that move within so many ms are one message")
        ] = 1
        sticky_buttons: Annotated[
            bool, Meta(description="a button stays pressed until it is pressed again"), READ_ONLY
        ] = False

    parameters: Parameters

    pad = Publisher(sensor.Joy, "joy", qos=QoS(priority="interactive_high"))
    """What the axes and buttons are at; stamped with when one of them moved."""

    _waiting: Waiting | None = None

    def on_start(self) -> None:
        """No pad is open yet."""
        if self.parameters.interface == "evdev":
            import_evdev()  # what cannot work is said at once
        self._wall = self.clock.wall
        self._missed = ""
        """Why there is no pad."""
        self._waiting = Waiting()

    def shutdown(self, exit_code: int = 0) -> None:
        """End the node: wakes what waits for the pad."""
        super().shutdown(exit_code)
        if self._waiting is not None:
            self._waiting.wake()

    def main(self) -> None:
        """Read the pad, whenever there is one."""
        while not self.stopping:
            try:
                device = self._opened()
            except DeviceGone as error:
                if str(error) != self._missed:  # once, however long it stays away
                    self._missed = str(error)
                    self.logger.warning("no pad: %s; it is waited for", self._missed)
                self._waits_for([], RETRY)
                continue
            self._missed = ""
            self.logger.info("reads %s, %d axes, %d buttons", device.name or "a pad", device.axes, device.buttons)
            try:
                self._tell(device)
            except DeviceGone as error:
                self.logger.warning("the pad is gone: %s; it is waited for", error)
                self._waits_for([], RETRY)
            finally:
                device.close()

    @check("pad")
    def pad_is_there(self) -> Health:
        """Whether there is a pad."""
        return Health.error(f"no pad: {self._missed}") if self._missed else Health.ok()

    def _opened(self) -> Device:
        p = self.parameters
        return open_device(p.interface, p.device, p.device_id, p.device_name)

    def _tell(self, device: Device) -> None:
        """Publish what a pad says until it is gone.

        Raises:
            DeviceGone: it was unplugged.
        """
        pad = Pad(device.axes, device.buttons, sticky=self.parameters.sticky_buttons)
        moved, last, change_due = self.now(), -math.inf, math.inf
        events = device.read()
        while not self.stopping:
            p, now = self.parameters, self._wall.monotonic()
            if events:
                moved = self.now()
                buttons = [pad.take(event) for event in events]
                # A button waits for nothing.
                change_due = min(change_due, now if any(buttons) else now + p.coalesce_interval_ms * 1e-3)
            repeats = p.autorepeat_rate > 0 and last > -math.inf
            due = min(change_due, last + 1.0 / p.autorepeat_rate if repeats else math.inf)
            if now >= due:
                self._publish(pad, moved)
                last, change_due, events = now, math.inf, []
                continue
            ready = self._waits_for([device.fd], min(due - now, RETRY))
            events = device.read() if device.fd in ready else []

    def _publish(self, pad: Pad, moved: Time) -> None:
        self.pad.publish(sensor.Joy(Header(moved), pad.axes(self.parameters.deadzone), pad.buttons))

    def _waits_for(self, fds: list[int], timeout: float) -> list[int]:
        """Wait until one can be read, or the node is told to stop."""
        assert self._waiting is not None
        return self._waiting.wait(fds, timeout)

    def on_stop(self) -> None:
        """Give back what woke it."""
        if self._waiting is not None:
            self._waiting.close()


if __name__ == "__main__":
    robo.run(Joy)
