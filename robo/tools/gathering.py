"""Whom a tool waits for: robots link anew when the one at whose router they met has left."""

import time

import zenoh

from robo.tools import runs
from robo.wire import meeting

_PERIOD = 0.02
"""How often it is asked who is there, s."""


def wait_for_others(session: zenoh.Session, timeout: float) -> None:
    """Wait for the robots of this user that meet where a session has come to, if the place was taken over just now.

    Until they have linked to its router, a tool that comes to it sees one robot alone, and would take the others for
    gone. Those that are there tell so by their logs, and have come when their supervisors answer. Their tokens do not
    say it: the router has them from before for a moment.

    Args:
        session: a client of the router at the meeting place.
        timeout: how long to wait at most, s.
    """
    end = time.monotonic() + min(meeting.gathers_for(), timeout)
    if (left := end - time.monotonic()) <= 0.0:
        return
    from robo.tools import logs  # which mostly need not be read

    awaited = {run.info.run for run in logs.live_runs() if meeting.endpoint() in run.info.endpoints}
    while left > 0.0 and not awaited <= {status.run for status in runs.processes(session, timeout=left)}:
        time.sleep(_PERIOD)
        left = end - time.monotonic()
