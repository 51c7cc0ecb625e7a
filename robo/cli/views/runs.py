"""`robo ps`, `stop`, `start`, `restart`, `down`, `why` and `events`: printing what supervisors say."""

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress

import msgspec
import zenoh

from robo.cli.connection import connect_to_supervisors, see_that_it_obeys
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
from robo.errors import NetworkError, NodeNotFound, RunError, UsageError
from robo.text import colours
from robo.text.durations import duration
from robo.tools import nodes, runs, strangers, unsupervised
from robo.wire import whereabouts
from robo.wire.explained import explained
from robo.wire.keys import NodeToken, SupervisorToken
from robo.wire.network import Network
from robo.wire.reports import Event, ProcessStatus

STATE_COLOURS = {
    "ready": colours.GREEN,
    "completed": colours.GREEN,
    "degraded": colours.YELLOW,
    "restarting": colours.YELLOW,
    "starting": colours.CYAN,
    "standby": colours.CYAN,
    "failed": colours.RED,
}


def print_processes(reach: Reach, *, json: bool, watch: bool, interval: float) -> None:
    """Print the table of processes, once or again and again.

    Raises:
        RunError: no supervisor answers.
    """
    with connect_to_supervisors(reach) as session, watched(session, reach) as link:
        alone = unsupervised.Processes(session)
        while True:
            there = nodes.list_nodes(session)
            found, problem = _supervised(session, reach)
            found = _with_twins([*found, *alone.look(there, found, reach.robot or "")], there)
            if problem is not None and not found and not watch:
                raise problem
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


def _supervised(session: zenoh.Session, reach: Reach) -> tuple[list[ProcessStatus], RunError | None]:
    """What supervisors run just now, or why there is none: a robot that does not answer may come back."""
    try:
        return (runs.processes(session, reach.robot) if reach.robot is not None else runs.all_processes(session)), None
    except RunError as error:
        return [], error


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
        str(status.restarts) if status.run else "-",
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
    with connect_to_supervisors(reach) as session:
        target = runs.target_of(session, reach.robot, names)
        see_that_it_obeys(session, reach, robot=target.robot)
        done = runs.command(session, target, verb, names)
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
    with connect_to_supervisors(reach) as session:
        there = runs.supervisors(session) if reach.robot is None else []
        see_that_it_obeys(session, reach, robot=there[0].robot if len(there) == 1 else "")
        if reach.robot is None:
            robots = _robots_to_end(there, every=every or everyone, everyone=everyone)
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
    """Print why nodes are as they are; where no robot runs any more, how the last run has ended.

    Raises:
        RoboError: there is no such robot or node.
    """
    try:
        _why(names, reach, json=json)
    except (NetworkError, RunError):
        from robo.cli.views.last_run import print_last_run  # which reads recordings
        from robo.tools.last_run import last_run

        told = whereabouts.is_told(reach.connect)
        places = Network.from_environment("client", reach.connect).connect if told else ()
        last = last_run(reach.robot, places, names) if not json else None
        if last is None:
            raise
        print_last_run(last)


def _why(names: Sequence[str], reach: Reach, *, json: bool) -> None:
    with connect_to_supervisors(reach) as session:
        target = runs.target_of(session, reach.robot, names)
        try:
            found = runs.explain(session, target, names)
        except NodeNotFound as error:
            raise _alone(session, names, reach) or error from None
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


def _alone(session: zenoh.Session, names: Sequence[str], reach: Reach) -> NodeNotFound | None:
    """Why supervisors know nothing of a node that runs, if it is one of those that are meant and no supervisor's."""
    there = nodes.list_nodes(session, reach.timeout)
    for name in names:
        with suppress(NodeNotFound):
            token = nodes.find_node(there, name)
            if not token.run:
                by = f"process {token.pid} on {token.host}"
                return NodeNotFound(
                    f"no supervisor runs {token.full_name} ({by}); `robo node info {token.full_name}` tells of it"
                )
    return None


def print_events(reach: Reach, *, json: bool, follow: bool) -> None:
    """Print what has happened and what happens, until Ctrl-C."""
    with connect_to_supervisors(reach) as session, watched(session, reach):
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
