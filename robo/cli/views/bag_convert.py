"""`robo bag convert`: recordings in other forms."""

from collections.abc import Sequence
from typing import NamedTuple

from robo import bag
from robo.bag.forms.choice import Form, form_of_input, form_of_output
from robo.bag.forms.converted import Converted, Wanted
from robo.bag.forms.from_carmen import Setting, from_carmen
from robo.bag.forms.from_csv import from_csv
from robo.bag.forms.json_lines import from_json_lines, to_json_lines
from robo.bag.forms.lines import STANDARD
from robo.bag.forms.to_csv import to_csv
from robo.bag.mcap.compression import Compression
from robo.bag.of_robot import only_robot
from robo.bag.progress import Tell
from robo.cli.printing import amount, note, print_line
from robo.cli.views.bag_progress import progress
from robo.errors import BagError, UsageError
from robo.text.patterns import chosen, matcher
from robo.text.terminal import visible

_MOST_TOLD = 20
"""Names of topics."""


class Conversion(NamedTuple):
    """What is asked for."""

    source: str
    output: str
    topics: Sequence[str]
    exclude: Sequence[str]
    from_: str | None
    to: str | None
    namespace: str
    compression: Compression
    force: bool


def convert(asked: Conversion) -> None:
    """Write a recording in another form, and tell what is left out.

    Raises:
        UsageError: the forms do not go together.
        BagError: something cannot be read, written, or held by the other form.
    """
    source, target = form_of_input(asked.source, asked.from_), form_of_output(asked.output, asked.to)
    if (source == "mcap") == (target == "mcap"):
        raise UsageError(
            "both are .mcap: robo bag cut, filter and merge make one of another" if source == "mcap"
            else f"from {source} to {target} it takes two steps: make a .mcap of it first"
        )  # fmt: skip
    if asked.namespace and source != "carmen":
        raise UsageError("--robot-name is for logs of CARMEN, which name no robot; other recordings say their topics")
    with progress(f"converting {asked.source}") as tell:
        done = _from_mcap(asked, target, tell) if source == "mcap" else _to_mcap(asked, source, tell)
    for text in done.notes:
        note(visible(text))
    told = f"{done.output}: {amount(done.messages, 'message')} on {amount(done.topics, 'topic')}"
    if asked.output == STANDARD:
        return
    print_line(told)


def _from_mcap(asked: Conversion, target: Form, tell: Tell) -> Converted:
    with bag.open(asked.source) as opened:
        wanted = chosen(opened.topics, asked.topics, asked.exclude, asked.source, robot=only_robot(opened))
        write = to_csv if target == "csv" else to_json_lines
        return write(opened, asked.output, wanted=wanted, force=asked.force, tell=tell)


def _to_mcap(asked: Conversion, source: Form, tell: Tell) -> Converted:
    meant = matcher(asked.topics, asked.exclude, asked.namespace)
    there: set[str] = set()

    def wanted(name: str) -> bool:
        if len(there) < _MOST_TOLD:
            there.add(name)
        return meant(name)

    try:
        return _read(asked, source, wanted, tell)
    except BagError:
        if there and not any(map(meant, there)):
            note(visible(f"no topic of those that are there is wanted: {', '.join(sorted(there))}"))
        raise


def _read(asked: Conversion, source: Form, wanted: Wanted, tell: Tell) -> Converted:
    path, output, force = asked.source, asked.output, asked.force
    if source == "carmen":
        setting = Setting(namespace=asked.namespace)
        return from_carmen(path, output, setting, asked.compression, wanted=wanted, force=force, tell=tell)
    read = from_csv if source == "csv" else from_json_lines
    return read(path, output, asked.compression, wanted=wanted, force=force, tell=tell)
