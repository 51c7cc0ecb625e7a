"""Whom a tool waits for: robots link anew when the router at which they met has left, or was held up."""

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
    within = min(meeting.gathers_for(), timeout)
    if within > 0.0:
        _wait_for_all(session, {meeting.endpoint()}, within)


def wait_for_supervisors(session: zenoh.Session, timeout: float) -> None:
    """Wait for the robots that meet where a session has come to, if it sees no supervisor and one lives here.

    All links of a router that was held up for longer than they bear are made anew, and a tool that waited at it may be
    in first: it would say that no robot was started.

    Args:
        session: a client of a router.
        timeout: how long to wait at most, s.
    """
    if not runs.supervisors(session, timeout=timeout):
        places = {str(link.dst) for link in session.info.links()}
        _wait_for_all(session, places, min(meeting.LINKED_WITHIN, timeout))


def _wait_for_all(session: zenoh.Session, places: set[str], within: float) -> None:
    """Wait until all supervisors answer that live on this machine and are met at one of some places."""
    from robo.tools import logs  # which mostly need not be read

    end = time.monotonic() + within
    awaited = {run.info.run for run in logs.live_runs() if not places.isdisjoint(run.info.endpoints)}
    while (left := end - time.monotonic()) > 0.0:
        if awaited <= {status.run for status in runs.processes(session, timeout=left)}:
            break
        time.sleep(_PERIOD)
