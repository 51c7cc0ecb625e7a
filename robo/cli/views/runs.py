"""`robo ps`, `stop`, `start`, `restart`, `down`, `why` and `events`: printing what supervisors say."""

import time
from collections.abc import Iterator, Sequence

import msgspec
import zenoh

from robo.cli.connection import connect_to_robot
from robo.cli.link import watched
from robo.cli.printing import (
    clear_screen,
    clock_time,
    hint,
    note,
    paint,
    print_json,
    print_line,
    print_lines,
    print_table,
)
from robo.cli.reach import Reach
from robo.errors import RunError, UsageError
from robo.text import colours
from robo.tools import nodes, runs, strangers
from robo.tools.strangers import Stranger
from robo.wire.keys import NodeToken, SupervisorToken
from robo.wire.reports import HEALTH_LEVELS, Event, Exit, Explanation, ProcessStatus, check_name, health_of

STATE_COLOURS = {
    "ready": colours.GREEN,
    "completed": colours.GREEN,
    "degraded": colours.YELLOW,
    "restarting": colours.YELLOW,
    "starting": colours.CYAN,
    "standby": colours.CYAN,
    "failed": colours.RED,
}
_FLOW = 5
"""With fewer messages a topic is none of those on which they come all the time."""
_STALE = 2.0
"""An input of which nothing has come for so long is named by `robo why`, s."""


def print_processes(reach: Reach, *, json: bool, watch: bool, interval: float) -> None:
    """Print the table of processes, once or again and again.

    Raises:
        RunError: no supervisor answers.
    """
    with connect_to_robot(reach) as session, watched(session, reach) as link:
        while True:
            found = _watched(session, reach) if watch else _asked_once(session, reach)
            found = _with_twins(found, nodes.list_nodes(session))
            if watch and not json:
                clear_screen()
            if json:
                for status in found:
                    print_json(status)
            elif watch and not found:
                note(link.lost or "no supervisor answers")
            else:
                print_table([_HEAD, *_rows(found)], _SPARED)
                _print_log_problems(found)
            if not watch:
                return
            time.sleep(interval)


def _asked_once(session: zenoh.Session, reach: Reach) -> list[ProcessStatus]:
    return runs.processes(session, reach.robot) if reach.robot is not None else runs.all_processes(session)


def _watched(session: zenoh.Session, reach: Reach) -> list[ProcessStatus]:
    """What runs just now: a robot that does not answer may come back."""
    try:
        return runs.processes(session, reach.robot)
    except RunError:
        return []


def _with_twins(found: Sequence[ProcessStatus], there: Sequence[NodeToken]) -> list[ProcessStatus]:
    """The processes, with a word on those that are not alone in what they do."""
    twins = {same.node: str(same) for same in nodes.twins(there)}
    return [
        msgspec.structs.replace(one, reason="; ".join(filter(None, (one.reason, twins[one.node].partition(" ")[2]))))
        if one.node in twins
        else one
        for one in found
    ]


def _print_log_problems(found: Sequence[ProcessStatus]) -> None:
    """Say of which runs nothing comes into the log files."""
    for robot, problem in dict.fromkeys((status.robot, status.log_problem) for status in found):
        if problem:
            print_line(f"{paint('!!', colours.RED)}  {robot}: {problem}")


_HEAD = ("ROBOT", "GROUP", "NODE", "STATE", "PID", "RESTARTS", "UPTIME", "CPU", "MEMORY", "OUT", "IN", "REASON")
_SPARED = ("ROBOT", "GROUP", "PID", "IN", "OUT", "UPTIME", "MEMORY", "CPU", "RESTARTS")
"""What a narrow terminal does without, from the first on: a node's full name tells its robot."""


def _rows(found: Sequence[ProcessStatus]) -> Iterator[tuple[str, ...]]:
    """A row for each node; those that share a process stand together below one of its own."""
    told: set[tuple[str, str, str]] = set()
    for status in found:
        if not status.process:
            yield _row(status)
            continue
        process = status.run, status.host, status.process
        if process in told:
            continue
        told.add(process)
        nodes = [one for one in found if (one.run, one.host, one.process) == process]
        yield _row_of_process(nodes)
        yield from map(_row, nodes)


def _row_of_process(nodes: Sequence[ProcessStatus]) -> tuple[str, ...]:
    """The process that nodes share: its id, its processor time and its memory."""
    running = next((one for one in nodes if one.pid is not None), nodes[0])
    pid = "-" if running.pid is None else str(running.pid)
    used = _percent(running.process_cpu), _megabytes(running.memory)
    return (
        running.robot,
        "-",
        f"{running.process}:",
        "-",
        pid,
        "-",
        "-",
        *used,
        "-",
        "-",
        "a process of several nodes",
    )


def _row(status: ProcessStatus) -> tuple[str, ...]:
    shares = status.process != ""
    return (
        status.robot,
        status.group or "-",
        f"  {status.node}" if shares else status.node,
        _painted(status.state),
        "-" if status.pid is None else str(status.pid),
        str(status.restarts),
        "-" if status.uptime is None else duration(status.uptime),
        _percent(status.cpu),
        "-" if shares else _megabytes(status.memory),
        _rate(status.published),
        _rate(status.received),
        status.reason
        or (f"{status.running} has been running for {duration(status.running_for)}" if status.running else "")
        or (f"{(status.health or '').upper()} {status.trouble}" if status.trouble else ""),
    )


def _percent(cpu: float | None) -> str:
    return "-" if cpu is None else f"{cpu:.0f}%"


def _megabytes(memory: int | None) -> str:
    return "-" if memory is None else f"{memory / 1e6:.0f}M"


def _rate(topics: dict[str, float]) -> str:
    return f"{sum(topics.values()):.0f}/s" if topics else "-"


def _painted(state: str) -> str:
    return paint(state, STATE_COLOURS[state]) if state in STATE_COLOURS else state


def command(verb: str, names: Sequence[str], reach: Reach, *, json: bool) -> None:
    """Have something done to nodes or groups, and say what was done.

    Raises:
        RoboError: there is no such robot or node, or it is not clear which robot is meant.
    """
    with connect_to_robot(reach) as session:
        done = runs.command(session, runs.target_of(session, reach.robot, names), verb, names)
    if json:
        print_json(done)
        return
    word = {"stop": "stopped", "start": "started", "restart": "restarted"}[verb]
    for node in done.nodes:
        print_line(f"{word} {node}")
    if not done.nodes:
        hint("nothing to do: all of it runs")


def down(reach: Reach, *, every: bool, everyone: bool, timeout: float) -> None:
    """End the run of a robot, or of all, and wait until it is over. A robot that is part of a run is stopped.

    Args:
        reach: which robot; where none is named, the only one of this user.
        every: all robots, but those of other users of this machine.
        everyone: those too.
        timeout: how long to wait for the end, s.

    Raises:
        RoboError: there is no such robot, it is not clear which is meant, or it does not end.
    """
    with connect_to_robot(reach) as session:
        if reach.robot is None:
            robots = _robots_to_end(runs.supervisors(session), every=every or everyone, everyone=everyone)
        else:
            target = runs.target_of(session, reach.robot)
            if target.part and not all(s.name.is_within(target.part) for s in runs.processes(session, target.robot)):
                runs.command(session, target, "stop", [])
                print_line(f"{target.part} is stopped; it is part of the run {target.robot}, which goes on")
                note(f"`robo start {target.part}` starts it; `robo down --robot-name {target.robot}` ends the run")
                return
            robots = [target.robot]
        supervisors = {r: runs.supervisors_of(session, r) for r in robots}
        for name in robots:
            runs.command(session, runs.Target(name), "down", [])
    for name, found in supervisors.items():
        for supervisor in found:
            runs.wait_for_end(supervisor, timeout)
        print_line(f"{name} is down")


def _robots_to_end(found: Sequence[SupervisorToken], *, every: bool, everyone: bool) -> list[str]:
    """The robots that are ended where none is named.

    Raises:
        UsageError: it is not clear which, or they are another user's.
        RunError: there is none.
    """
    whose = {token.robot: token.user for token in found if not everyone and not runs.is_mine(token)}
    robots = sorted({token.robot for token in found} - whose.keys())
    others = ", ".join(f"{robot} of {user}" for robot, user in sorted(whose.items()))
    if not found:
        raise RunError("no supervisor answers: no robot was started here with `robo up`")
    if not robots:
        raise UsageError(f"other users run {others}; --everyone, or --robot-name, ends what is theirs")
    if every and others:
        note(f"left alone: {others}; --everyone ends what is of other users too")
    if len(robots) > 1 and not every:
        raise UsageError(f"several robots run: {', '.join(robots)}; say --robot-name, or --all")
    return robots


def why(names: Sequence[str], reach: Reach, *, json: bool) -> None:
    """Print why nodes are as they are.

    Raises:
        RoboError: there is no such robot or node.
    """
    with connect_to_robot(reach) as session:
        target = runs.target_of(session, reach.robot, names)
        found = runs.explain(session, target, names)
        lost = runs.lost_sites(session, target.robot)
        refused = strangers.refused(nodes.all_status(session, reach.timeout)) if not json else []
    for site in lost if not json else ():
        print_line(site)
    for explanation in found:
        if json:
            print_json(explanation)
        else:
            print_lines(explained(explanation, [one for one in refused if one.receiver == explanation.process.node]))
    if not json:
        _print_log_problems([explanation.process for explanation in found])


def explained(found: Explanation, refused: Sequence[Stranger] = ()) -> list[str]:
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
        lines.append(f"  {_when(ended)} {ended.reason}, after {duration(ended.uptime)}")
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


def _when(ended: Exit) -> str:
    return time.strftime("%H:%M:%S", time.localtime(ended.time / 1e9))


def print_events(reach: Reach, *, json: bool, follow: bool) -> None:
    """Print what has happened and what happens, until Ctrl-C."""
    with connect_to_robot(reach) as session, watched(session, reach):
        stream = runs.EventStream(session, reach.robot)
        seen: set[tuple[int, str, str]] = set()
        for event in stream.past():
            seen.add((event.time, event.node, event.event))
            _print_event(event, json=json)
        if not follow:
            return
        for event in stream.coming():
            if (event.time, event.node, event.event) not in seen:
                _print_event(event, json=json)


def _print_event(event: Event, *, json: bool) -> None:
    if json:
        print_json(event)
        return
    who = event.node or event.robot
    print_line(f"{clock_time(event.time)} {who} {event.event}{f': {event.reason}' if event.reason else ''}")


def times(count: int) -> str:
    """How often, in words."""
    return "once" if count == 1 else f"{count} times"


def duration(seconds: float) -> str:
    """A time span in words, coarser the longer it is."""
    if seconds < 60:
        return f"{seconds:.1f}s"
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    if days:
        return f"{days}d{hours:02d}h"
    return f"{hours}h{minutes:02d}m" if hours else f"{minutes}m{rest:02d}s"
