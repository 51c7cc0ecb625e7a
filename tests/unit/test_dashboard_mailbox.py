"""What waits for a browser."""

from robo.dashboard.mailbox import Mailbox


def taken(box: Mailbox) -> list[bytes | str]:
    """All that it gives, as if the browser read nothing."""
    found = []
    while (frame := box.take()) is not None:
        found.append(frame.data)
    return found


def test_the_newest_of_each_channel_waits() -> None:
    box = Mailbox()
    box.put("scan", b"old")
    box.put("odom", b"odometry")
    box.put("scan", b"new")
    assert taken(box) == [b"new", b"odometry"], "in its turn: a quick channel does not hold itself back"
    assert box.skipped == 1


def test_what_is_urgent_comes_first_and_lines_before_pictures() -> None:
    box = Mailbox()
    box.put("image", b"image")
    box.add("line 1")
    box.add("line 2")
    box.put("beat", "beat", urgent=True)
    assert taken(box) == ["beat", "line 1", "line 2", b"image"]


def test_a_browser_that_does_not_read_gets_no_more_than_fits() -> None:
    box = Mailbox(most_unread=1000)
    for number in range(10):
        box.put(number, bytes(400))
    assert len(taken(box)) == 3
    assert box.unread == 1200
    box.put(9, bytes(500))
    box.has_read(2)
    assert [len(data) for data in taken(box)] == [400, 400]
    box.put("beat", "beat", urgent=True)
    assert taken(box) == ["beat"], "it is told that the server lives all the same"


def test_more_is_read_than_was_sent() -> None:
    box = Mailbox()
    box.put("a", b"a")
    taken(box)
    box.has_read(100)
    assert box.unread == 0


def test_what_waits_takes_bounded_memory() -> None:
    box = Mailbox(most_unread=0)
    for number in range(5_000):
        box.add(f"line {number}")
        box.put("image", bytes(1000))
    assert box.left_out == 3_000
    box.has_read(1)
    assert box.take() is None, "no unread byte is allowed here"


def test_a_channel_that_nobody_looks_at_is_dropped() -> None:
    box = Mailbox()
    box.put("scan", b"scan")
    box.drop("scan")
    box.drop("scan")
    assert taken(box) == []


def test_lines_that_wait_take_bounded_memory_however_long_they_are() -> None:
    box = Mailbox()
    for _ in range(100):
        box.add("x" * 1_000_000)
    assert len(taken(box)) == 1, "what is on its way is bounded as well"
    assert box.left_out == 98


def test_a_browser_that_never_says_what_it_has_read_is_lost() -> None:
    box = Mailbox()
    for number in range(5_001):
        assert not box.is_lost
        box.put("beat", str(number), urgent=True)
        taken(box)
    assert box.is_lost
