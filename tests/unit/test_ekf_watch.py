"""Who is heard and who is believed: only measurements count, and time may step back."""

from robo_services.ekf import VX, VY, VYAW, Measurement
from robo_services.ekf_watch import Source, Watch

SOURCES = {
    "vyaw": Source("/odom", frozenset({"vx"})),  # named as a quantity is, which it does not say
    "imu": Source("/imu", frozenset({"vyaw"})),
}


def of(*indices: int, assumed: bool = False) -> Measurement:
    n = len(indices)
    return Measurement(0.0, "s", indices, (0.0,) * n, [[1.0] * n] * n, assumed=assumed)


def test_only_what_is_measured_is_heard() -> None:
    watch = Watch(SOURCES)
    watch.hear("vyaw", [of(VY, assumed=True)], 1.0, 1.0)
    watch.hear("imu", [], 1.0, 1.0)
    assert watch.silent(1.0, 0.25) == ["vyaw", "imu"]
    assert watch.unheard(1.0, 0.25) == "nothing new of how far it drives on /odom"
    watch.hear("vyaw", [of(VX), of(VY, assumed=True)], 1.0, 1.0)
    assert watch.silent(1.2, 0.25) == ["imu"]
    assert watch.unheard(1.2, 0.25) == "nothing new of how it turns on /imu"
    watch.hear("imu", [of(VYAW)], 1.1, 1.2)
    assert watch.unheard(1.2, 0.25) == ""
    assert watch.unheard(1.3, 0.25) == "nothing new of how far it drives on /odom"
    assert Watch({}).unheard(0.0, 0.25) == "nothing new of how far it drives on any topic: no source has it"


def test_what_is_heard_has_some_time_to_be_believed() -> None:
    watch = Watch(SOURCES)
    watch.trust(1.0)
    watch.believe({VYAW}, 1.2)
    assert watch.doubted(1.2, 0.25) == ""
    assert watch.doubted(1.3, 0.25) == "what is heard of how far it drives is not believed"
    watch.believe({VX}, 1.4)
    assert watch.doubted(1.5, 0.25) == "what is heard of how it turns is not believed"


def test_after_time_has_stepped_back_what_was_before_does_not_count() -> None:
    watch = Watch(SOURCES)
    watch.hear("imu", [of(VX, VYAW)], 90.0, 90.0)
    assert watch.unheard(1.0, 0.25) != ""
    assert watch.silent(1.0, 0.25) == ["vyaw", "imu"]
    watch.hear("imu", [of(VX, VYAW)], 1.0, 1.0)
    assert watch.unheard(1.0, 0.25) == ""
    watch.hear("imu", [of(VX, VYAW)], 0.5, 1.0)
    assert watch.unheard(1.2, 0.25) == "", "an older message is no news"
