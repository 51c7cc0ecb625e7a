"""How the board of `serial_base` and its wheels are described."""

import math
from typing import Annotated, Literal

from msgspec import Meta

from robo import READ_ONLY, Unit
from robo_services.arduino_protocol import BYTES_PER_PERIOD, MOST_TICKS
from robo_services.base_parameters import WheeledParameters, WheelVelocity

USB_ID = r"^([0-9A-Fa-f]{4}:[0-9A-Fa-f]{4}(:.+)?)?$"
"""Maker and product in hexadecimal digits, or with the serial number behind them."""

GAINS = r"^([0-9]{1,4}:[0-9]{1,4}:[0-9]{1,4}:[1-9][0-9]{0,3})?$"
"""The firmware divides by the last one, has 16-bit numbers, and 15 letters of memory for all four."""
BITS_PER_BYTE = 10
"""On the wire: one to begin, eight, and one to end."""
PATIENCE = 3
"""Periods: a board that was not heard in a shorter time has not fallen silent."""


class SerialBaseParameters(WheeledParameters):
    """The board and its wheels."""

    port: Annotated[str, Meta(description="its device, such as /dev/ttyUSB0; empty: usb_id"), READ_ONLY] = ""
    usb_id: Annotated[
        str,
        Meta(
            pattern=USB_ID,
            description="maker and product on USB, such as 2341:0043, :SERIAL behind it; empty: the only one there",
        ),
        READ_ONLY,
    ] = ""
    baud: Annotated[
        int, Meta(ge=1200, le=4_000_000, description="bits per second, the firmware's BAUDRATE"), READ_ONLY
    ] = 57_600
    ticks_per_revolution: Annotated[
        float, Meta(ge=1, le=1e7, description="what an encoder counts in a revolution of its wheel"), READ_ONLY
    ] = 1440.0
    counter_bits: Annotated[
        Literal[16, 32], Meta(description="of a counter, which then begins anew; the firmware has 32"), READ_ONLY
    ] = 32
    loop_period: Annotated[
        float,
        Meta(ge=0.001, le=1, description="of the board's loop: its speeds are ticks in this time"),
        Unit("s"),
        READ_ONLY,
    ] = 0.033
    gains: Annotated[
        str,
        Meta(pattern=GAINS, max_length=15, description="of its loop, kp:kd:ki:ko; empty: its own"),
        READ_ONLY,
    ] = ""
    trim: Annotated[
        float,
        Meta(ge=0, le=10, description="at most so many ticks per loop are added where a wheel is slow, or fast"),
        READ_ONLY,
    ] = 3.0
    max_wheel_velocity: WheelVelocity = 20.0
    rate: Annotated[
        float,
        Meta(ge=10, le=200, description="speeds said, encoders asked for and odometry told per second"),
        Unit("Hz"),
        READ_ONLY,
    ] = 30.0
    start_timeout: Annotated[
        float, Meta(ge=0.5, le=60, description="a board may start for this long"), Unit("s"), READ_ONLY
    ] = 4.0
    answer_timeout: Annotated[
        float,
        Meta(ge=0.1, le=10, description="a board that says nothing for this long is asked anew who it is"),
        Unit("s"),
        READ_ONLY,
    ] = 0.5
    joint_states: Annotated[bool, Meta(description="publish joint_states: how far wheels have turned"), READ_ONLY] = (
        False
    )
    left_wheel_name: Annotated[str, Meta(min_length=1, description="the left wheel's joint"), READ_ONLY] = (
        "left_wheel_joint"
    )
    right_wheel_name: Annotated[str, Meta(min_length=1, description="the right wheel's joint"), READ_ONLY] = (
        "right_wheel_joint"
    )
    battery_pin: Annotated[
        int, Meta(ge=-1, le=63, description="the analogue pin that measures the battery; -1: none"), READ_ONLY
    ] = -1
    battery_full_scale: Annotated[
        float, Meta(ge=0.1, le=1000, description="the battery's voltage at which the pin says 1023"), Unit("V")
    ] = 5.0

    def __post_init__(self) -> None:
        """Refuse what does not go together."""
        if self.rate * BYTES_PER_PERIOD * BITS_PER_BYTE > self.baud:  # the line would obey what was said long ago
            most = self.baud / (BYTES_PER_PERIOD * BITS_PER_BYTE)
            raise ValueError(f"rate = {self.rate:g} is too much for baud = {self.baud}: at most {most:g}")
        if self.answer_timeout < PATIENCE / self.rate:
            least = f"at least {PATIENCE} periods, {PATIENCE / self.rate:.2g} s"
            raise ValueError(f"answer_timeout = {self.answer_timeout:g} is too short for rate = {self.rate:g}: {least}")
        most = MOST_TICKS * math.tau / self.ticks_per_revolution / self.loop_period
        if self.max_wheel_velocity > most:  # the board's numbers would run over
            text = f"max_wheel_velocity = {self.max_wheel_velocity:g} is more than {MOST_TICKS} ticks in a loop_period"
            raise ValueError(f"{text} with ticks_per_revolution = {self.ticks_per_revolution:g}: at most {most:.3g}")
