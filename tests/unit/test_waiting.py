"""Waiting for files to be readable, and being woken."""

import fcntl
import os
import resource

import pytest

from robo_services.waiting import Waiting, is_readable


def test_a_file_above_the_1024th_is_waited_for() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 1100:
        pytest.skip("this machine opens no 1,100 files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 1100), hard))
    read, write = os.pipe()
    high = fcntl.fcntl(read, fcntl.F_DUPFD, 1050)
    waiting = Waiting()
    try:
        assert waiting.wait([high], 0.0) == []
        os.write(write, b"a")
        assert waiting.wait([high], 5.0) == [high]
        assert is_readable(high, 5.0)
    finally:
        waiting.close()
        for fd in (read, write, high):
            os.close(fd)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_who_wakes_what_was_given_back_writes_to_nobody() -> None:
    waiting = Waiting()
    waiting.wake()
    assert waiting.wait([], 100.0) == []
    waiting.close()
    others = [os.pipe() for _ in range(4)]  # they have the numbers of what was closed
    waiting.wake()
    waiting.close()
    for read, write in others:
        assert not is_readable(read, 0.0)
        os.close(read)
        os.close(write)
