"""The processes of a run, as far as they are known by name."""

from robo.machine.child import Spawned


def test_a_watchdog_hears_of_all_but_itself() -> None:
    heard: list[tuple[int, bool]] = []
    spawned = Spawned(7, lambda pid, running: heard.append((pid, running)))
    assert 7 in spawned, "nobody else may collect it"
    spawned.add(8)
    assert 8 in spawned
    spawned.discard(8)
    assert 8 not in spawned
    assert heard == [(8, True), (8, False)], "told of itself it would end itself before the rest"
