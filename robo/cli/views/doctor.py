"""`robo doctor`: printing what the checks find."""

from collections.abc import Sequence

from robo.cli.printing import paint, print_json, print_line
from robo.text import colours
from robo.tools import doctor

_MARKS = {"ok": ("ok", colours.GREEN), "note": ("note", colours.YELLOW), "fault": ("FAULT", colours.RED)}


def examine(*, kill_test: bool, ask_ports: bool, json: bool, connect: Sequence[str]) -> int:
    """Run the checks and print each at once.

    Returns:
        The exit code.
    """
    faults = 0
    for finding in doctor.examine(connect, kill_test=kill_test, ask_ports=ask_ports):
        faults += finding.verdict == "fault"
        if json:
            print_json(finding)
            continue
        word, colour = _MARKS[finding.verdict]
        print_line(f"{paint(f'{word:5}', colour)} {finding.check:10} {finding.message}")
        if finding.fix:
            print_line(f"{'':16} {finding.fix}")
    return 1 if faults else 0
