"""`robo why` where no robot runs any more: printing what the last run has left."""

from robo.cli.printing import hint, print_line, print_lines
from robo.tools.last_run import LastRun
from robo.wire.explained import clock
from robo.wire.reports import LogRecord

_MOST_REASONS = 3
"""Of a file; more are counted."""


def print_last_run(last: LastRun) -> None:
    """Print how a run has ended."""
    info = last.run.info
    print_line(f"{info.robot} runs no more: it was started at {clock(info.begin)} with {info.manifest}")
    if last.end:
        print_line("  the last words of its supervisor:")
        print_lines([f"    {_line(one)}" for one in last.end])
    for file in last.files:
        print_line(f"  recorded at {clock(file.time)}: {file.path}")
        print_lines([f"    {reason}" for reason in file.reasons[:_MOST_REASONS]])
        if len(file.reasons) > _MOST_REASONS:
            print_line(f"    and {len(file.reasons) - _MOST_REASONS} more")
    for label, said in last.words.items():
        print_line(f"  the last words of {label}:" if said else f"  {label} has printed nothing")
        print_lines([f"    {_line(one)}" for one in said])
    hint(f"robo logs --run {last.run.folder.name}: all that was printed")


def _line(one: LogRecord) -> str:
    return f"{clock(one.time)} {f'{one.level} ' if one.level else ''}{one.message}"
