"""How much room there is for shared memory, and how much of it a process takes."""

import os

FOLDER = "/dev/shm"

MOST = 128 * 2**20
"""What a process takes at most, bytes, however slow its readers are."""


def free_bytes() -> int:
    """How much of shared memory is free on this machine; more than there can be where it does not say so."""
    try:
        room = os.statvfs(FOLDER)
    except OSError:
        return 2**62  # it says nothing, so it is tried
    return room.f_bavail * room.f_frsize if room.f_blocks else 2**62
