"""`robo restart --rolling`: robots or nodes one after another, and what became of each."""

import time
from collections.abc import Iterator, Sequence

from robo.cli.connection import connect_to_supervisors
from robo.cli.link import watched
from robo.cli.printing import clock_time, hint, note, paint, print_json, print_line, print_lines
from robo.cli.reach import Reach
from robo.errors import RunError
from robo.process.endings import raised_by_signals
from robo.text import colours
from robo.text.durations import duration
from robo.tools import runs
from robo.tools.rolling import Change, Choice, Rolling, choose
from robo.tools.rollout import Account, Stage, Terms
from robo.wire.explained import explained
from robo.wire.reports import Explanation, ProcessStatus

_WORDS: dict[Stage, tuple[str, str]] = {
    "restarting": ("is started again", colours.CYAN),
    "waiting": ("is not healthy yet", colours.YELLOW),
    "settling": ("is healthy", colours.CYAN),
    "done": ("is done", colours.GREEN),
    "failed": ("has failed", colours.RED),
}


def restart_rolling(words: Sequence[str], reach: Reach, terms: Terms, *, dry_run: bool, json: bool) -> int:
    """Start robots or nodes again, one after another, as long as each becomes healthy.

    Returns:
        The exit code: 0 all are done, 1 one did not become healthy, 130 Ctrl-C.

    Raises:
        RunError: no supervisor answers.
        NodeNotFound: nobody is meant.
    """
    with connect_to_supervisors(reach) as session, watched(session, reach):
        there = runs.all_processes(session) if reach.robot is None else runs.processes(session, reach.robot)
        if not words and reach.robot is None:
            there = _mine(there, {token.robot for token in runs.supervisors(session) if not runs.is_mine(token)})
        choice = choose(there, words, reach.namespace)
        for node, reason in choice.left_alone.items():
            note(f"left alone: {node}, for {reason}")
        if not choice.units:
            raise RunError("nothing of what is meant runs: nothing to start again")
        if dry_run:
            _print_order(choice, terms, json=json)
            return 0
        hint("Ctrl-C leaves those that have not begun as they are")
        rolling = Rolling(session, choice.units, terms, reach.timeout)
        begin = time.monotonic()
        interrupted = False
        try:
            with raised_by_signals():
                for change in rolling.changes():
                    _print_change(change, terms, json=json)
        except KeyboardInterrupt:
            interrupted = True
        account = rolling.rollout.account()
        why = rolling.why() if account.outcome == "stopped" else []
    if json:
        print_json({"outcome": account, "why": why})
    else:
        print_lines(_told(account, why, time.monotonic() - begin))
    return 130 if interrupted else 0 if account.outcome == "done" else 1


def _mine(there: Sequence[ProcessStatus], others: set[str]) -> list[ProcessStatus]:
    """Where nobody is named, robots of other users of this machine are left alone."""
    if others:
        note(f"left alone: {', '.join(sorted(others))} of other users; name them to start them again")
    return [one for one in there if one.robot not in others]


def _print_order(choice: Choice, terms: Terms, *, json: bool) -> None:
    if json:
        print_json([{"name": unit.name, "nodes": unit.nodes} for unit in choice.units])
        return
    for unit in choice.units:
        nodes = [node for nodes in unit.nodes.values() for node in nodes]
        print_line(unit.name if nodes == [unit.name] else f"{unit.name}: {', '.join(nodes)}")
    note(f"in this order, {terms.batch} at a time; without --dry-run they are started again")


def _print_change(change: Change, terms: Terms, *, json: bool) -> None:
    if json:
        print_json(change)
        return
    said, colour = _WORDS[change.stage]
    reason = f": {change.reason}" if change.reason else ""
    if change.stage == "settling":
        reason = f"; it has to stay so for {terms.settle:g} s"
    print_line(f"{clock_time(change.time)} {change.name} {paint(said, colour)}{reason}")


def _told(account: Account, why: Sequence[Explanation], took: float) -> Iterator[str]:
    """What has become of all, in lines."""
    for explanation in why:
        yield from explained(explanation, [])
    if account.outcome == "done":
        yield f"all of them are started again and healthy, within {duration(took)}: {', '.join(account.done)}"
        return
    for name, reason in account.failed.items():
        yield f"stopped at {name}: {reason}"
    if account.outcome == "interrupted":
        yield "interrupted"
    yield f"done:      {_listed(account.done)}"
    if account.under_way:
        yield f"under way: {_listed(account.under_way)} (told to start again; not known to be healthy)"
    yield f"untouched: {_listed(account.untouched)}"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
