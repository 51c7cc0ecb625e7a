"""What a supervisor knows of a node, in words: `robo why`, for terminals and for flight recorders."""

import time
from collections.abc import Sequence

from robo.text.durations import duration
from robo.wire.reports import HEALTH_LEVELS, Explanation, check_name, health_of

_FLOW = 5
"""With fewer messages a topic is none of those on which they come all the time."""
_STALE = 2.0
"""An input of which nothing has come for so long is named, s."""


def explained(found: Explanation, refused: Sequence[object] = ()) -> list[str]:
    """Why a node is in its state, and whose messages it leaves out, for people."""
    status = found.process
    for_how_long = f" for {duration(status.uptime)}" if status.uptime is not None else ""
    pid = f", process {status.pid}" if status.pid is not None else ""
    lines = [f"{status.node} is {status.state}{f': {status.reason}' if status.reason else ''}"]
    lines.append(f"  running{for_how_long}{pid}" if status.pid is not None else "  not running")
    if found.next_start is not None:
        lines.append(f"  starts again in {found.next_start:.1f} s")
    if status.state == "standby":
        lines.append(f"  robo lifecycle list {status.node}: what can be asked of it now")
    lines += [f"  waits for {need}" for need in found.unmet_needs]
    if status.running:
        how_long = duration(status.running_for)
        lines.append(f"  its callback {status.running} has been running for {how_long}; all others of its turn wait")
    lines += _failing(found)
    for entry in found.inputs:
        if status.running:
            pass  # what has come waits for that callback: the input is not to blame
        elif entry.age <= _STALE:
            pass  # a node tells once a second what it has received: in its first one, nothing so far
        elif entry.external or 0 < entry.received < _FLOW:
            pass  # a joystick is not there, a map has come once: nobody waits for more
        elif entry.received == 0:
            lines.append(f"  has received nothing on {entry.topic} for {duration(entry.age)}")
            whom = f"robo topic info {entry.topic}: who publishes it"
            lines.append(f"    {whom}; robo logs {status.node}: what it says of it")
        else:
            lines.append(f"  has received nothing on {entry.topic} for {duration(entry.age)}, {entry.received} before")
        if entry.malformed:
            lines.append(f"  could not read {entry.malformed} messages on {entry.topic}")
        if entry.dropped:
            lines.append(f"  fell behind by {entry.dropped} messages on {entry.topic}")
    lines += [f"  {one}" for one in refused]
    if found.callback_errors:
        lines.append(f"  its callbacks raised {times(found.callback_errors)}; robo logs {status.node} --level error")
    if status.restarts:
        lines.append(f"  started again {times(status.restarts)}")
    for ended in found.exits[-5:]:
        lines.append(f"  {clock(ended.time)} {ended.reason}, after {duration(ended.uptime)}")
    for snapshot in found.snapshots:
        lines.append(f"  recorded at {clock(snapshot.time)}: {snapshot.file} on {snapshot.host}")
    if found.exits and found.exits[-1].last_lines:
        lines.append("  its last words:")
        lines += [f"    {line}" for line in found.exits[-1].last_lines[-12:]]
    return lines


def _failing(found: Explanation) -> list[str]:
    """What a node says of itself that is not well."""
    if found.process.trouble != health_of(found.checks)[1]:  # what its supervisor knows better
        return [f"  {found.process.trouble}"]
    # The callback that runs has been told of already.
    told = {"callbacks"} if found.process.running else set()
    bad = [check for check in found.checks if check.level and check_name(check) not in told]
    worst_first = sorted(bad, key=lambda check: -check.level)
    return [f"  {HEALTH_LEVELS[check.level].upper()} {check_name(check)}: {check.message}" for check in worst_first]


def clock(at: int) -> str:
    """The time of day of ns since the epoch; with the date, where that is another day."""
    then = time.localtime(at / 1e9)
    return time.strftime("%H:%M:%S" if then[:3] == time.localtime()[:3] else "%Y-%m-%d %H:%M:%S", then)


def times(count: int) -> str:
    """How often, in words."""
    return "once" if count == 1 else f"{count} times"
