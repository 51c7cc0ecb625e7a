"""What `serial_base` refuses to be told of its board."""

import re

import msgspec
import pytest

from robo_services.serial_parameters import SerialBaseParameters


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"baud": 2400}, "rate = 30 is too much for baud = 2400: at most 7.5"),
        ({"baud": 9600, "rate": 31}, "rate = 31 is too much for baud = 9600: at most 30"),
        (
            {"answer_timeout": 0.1, "rate": 10},
            "answer_timeout = 0.1 is too short for rate = 10: at least 3 periods, 0.3 s",
        ),
        ({"ticks_per_revolution": 1e6}, "max_wheel_velocity = 20 is more than 32767 ticks in a loop_period"),
        ({"max_wheel_velocity": 5000.0}, "with ticks_per_revolution = 1440: at most 4.33e+03"),
        ({"rate": 5}, "rate"),
        ({"trim": 11}, "trim"),
    ],
)
def test_what_does_not_go_together_is_refused_with_the_names(given: dict[str, float], text: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=re.escape(text)):
        msgspec.convert(given, SerialBaseParameters)


@pytest.mark.parametrize("given", [{"baud": 9600}, {"rate": 10, "answer_timeout": 0.3}, {"rate": 170}])
def test_what_just_goes_together_is_taken(given: dict[str, float]) -> None:
    msgspec.convert(given, SerialBaseParameters)


@pytest.mark.parametrize(
    "gains", ["40000:12:0:50", "20:12:0:0", "20:12:0:00", "20:12:0", "1000:1000:1000:1000", "-1:0:0:9"]
)
def test_gains_with_which_it_would_run_away_are_refused(gains: str) -> None:
    """The firmware has numbers of 16 bits, divides by the last one, and has 16 bytes for all with their end."""
    with pytest.raises(msgspec.ValidationError, match="gains"):
        msgspec.convert({"gains": gains}, SerialBaseParameters)


@pytest.mark.parametrize("gains", ["", "20:12:0:50", "9999:12:0:50", "100:100:100:100"])
def test_gains_that_it_can_keep_are_taken(gains: str) -> None:
    assert msgspec.convert({"gains": gains}, SerialBaseParameters).gains == gains
