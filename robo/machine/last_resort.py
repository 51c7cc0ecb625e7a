"""A supervisor that is to end does end, even where it hangs: it is killed, and its watchdog ends the rest."""

import signal


def end_within(seconds: float) -> None:
    """Let this process be killed if it is still there then; the first call counts.

    The kernel does it: whatever hangs here, a blocked output or a library, cannot keep it from that.
    """
    if signal.getitimer(signal.ITIMER_REAL)[0] == 0.0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, seconds)
