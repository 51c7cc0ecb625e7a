"""Runs nodes against a recording, more than once, and judges what they say."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec

from robo import bag as bags
from robo.bag.read.reader import Bag
from robo.bag.regression import comparing
from robo.bag.regression.comparing import Extent, earliest_first
from robo.bag.regression.renewal import renew
from robo.bag.regression.report import ReplayReport, TopicReport
from robo.bag.regression.tolerances import Tolerances, load
from robo.errors import RoboError, UsageError
from robo.testing.regression.chosen import choose
from robo.testing.regression.order import RunOrder, RunResult
from robo.testing.regression.phase import phase, start_before
from robo.testing.regression.pictures import draw
from robo.testing.regression.runs import run_apart

MARK = "robo.replay"
"""The metadata of a recording of which outputs come from a replay: when it began, and by node the topics."""

RUNS = 2
LONGEST = 1e6
"""Of a patience, s."""


class Request(msgspec.Struct, kw_only=True):
    """What is asked."""

    bag: str
    nodes: list[str]
    manifest: str | None = None
    robot: str | None = None
    arguments: dict[str, str] = {}
    parameters: dict[str, Any] = {}
    """Of all these nodes."""
    settings: dict[str, Any] = {}
    """By `NODE.PARAMETER`."""
    tolerances: str | None = None
    ignored: list[str] = []
    runs: int = RUNS
    accept: bool = False
    output: str | None = None
    plots: str | None = None
    patience: float = 10.0


Progress = Callable[[float, str], None]
"""Takes how much of a stage is done, 0 to 1, and which stage."""


def judge(request: Request, progress: Progress = lambda _done, _stage: None) -> ReplayReport:
    """Replay, and compare.

    Raises:
        RoboError: what is asked makes no sense, or a file cannot be read or written.
    """
    if request.runs < 1:
        raise UsageError(f"{request.runs} runs: use 1 or more")
    if request.output is not None and not request.accept:
        raise UsageError("-o says where --accept writes to; say --accept too")
    if not 0 < request.patience <= LONGEST:  # NaN is neither
        raise UsageError(f"a patience of {request.patience:g} s: use more than 0 and at most {LONGEST:g}")
    tolerances = load(request.tolerances, request.ignored)
    with ExitStack() as made:
        recording = made.enter_context(bags.open(request.bag))
        if request.accept and request.output is None and not Path(request.bag).is_file():
            raise UsageError(f"{request.bag} is a folder; -o says which file is the new reference")
        folder = Path(made.enter_context(tempfile.TemporaryDirectory(prefix="robo-replay-")))
        return _Judge(request, recording, tolerances, folder, progress, made).judge()


class _Judge:
    def __init__(
        self,
        request: Request,
        recording: Bag,
        tolerances: Tolerances,
        folder: Path,
        progress: Progress,
        made: ExitStack,
    ) -> None:
        self._request = request
        self._bag = recording
        self._tolerances = tolerances
        self._folder = folder
        self._progress = progress
        self._made = made
        self._mark: Mapping[str, str] = recording.metadata.get(MARK, {})
        self._renewed = {name for words in self._mark.values() for name in words.split()}
        self._report = ReplayReport(bag=request.bag, begin=recording.begin, duration=recording.duration)

    def judge(self) -> ReplayReport:
        request, report = self._request, self._report
        chosen = choose(
            self._bag,
            request.nodes,
            request.manifest,
            request.robot,
            request.arguments,
            request.parameters,
            request.settings,
        )
        begin = int(self._mark["begin"]) if self._mark.get("begin", "").isdecimal() else None
        order = RunOrder(
            bag=request.bag,
            nodes=chosen.nodes,
            output=str(self._folder / "1.mcap"),
            begin=begin,
            others=chosen.others,
            patience=request.patience,
        )
        first = self._run(order, 1)
        if not first.troubles and begin is None:
            start = self._phase(first)
            if start is not None:
                order = msgspec.structs.replace(order, begin=start, output=str(self._folder / "phase.mcap"))
                first = self._run(order, 1)
        report.nodes, report.inputs, report.seconds = first.nodes, first.inputs, first.seconds
        report.notes += first.notes
        report.runs = 1
        if first.troubles:
            return self._failed(first)
        now = self._made.enter_context(bags.open(order.output))
        for number in range(2, request.runs + 1):
            output = str(self._folder / f"{number}.mcap")
            again = self._run(msgspec.structs.replace(order, output=output, other_clocks=True), number)
            report.runs = number
            if again.troubles:
                report.notes.append(
                    f"run 1 went without this; in run {number} hashes have another order, random numbers are others, "
                    "and the clocks of the wall show something else"
                )
                return self._failed(again)
            with bags.open(output) as other:
                exact = self._tolerances.only_ignored(), Extent(exact=True)
                both = dict.fromkeys([*first.outputs, *again.outputs])
                found = [self._compare(now, other, name, *exact) for name in both]
            Path(output).unlink()
            broken = [topic for topic in found if not topic.same]
            if broken:
                report.topics, report.verdict = earliest_first(broken, now), "not deterministic"
                return report
        return self._accept(first, now) if request.accept else self._against_recording(first, now)

    def _run(self, order: RunOrder, number: int) -> RunResult:
        stage = f"run {number} of {self._request.runs}"
        self._progress(0.0, stage)
        return run_apart(order, number, lambda done: self._progress(done, stage))

    def _failed(self, run: RunResult) -> ReplayReport:
        # A process that has died did not say when.
        told = [msgspec.structs.replace(one, time=one.time or self._bag.begin) for one in run.troubles]
        self._report.troubles, self._report.verdict = told, "failed"
        return self._report

    def _compare(self, then: Bag, now: Bag, name: str, tolerances: Tolerances, extent: Extent) -> TopicReport:
        self._progress(1.0, f"comparing {name}")
        return comparing.compare(then, now, name, tolerances, extent)

    # -- against the recording ---------------------------------------------------------------------------------------

    def _against_recording(self, run: RunResult, now: Bag) -> ReplayReport:
        report = self._report
        for name in self._outputs(run):
            if name in self._bag.topics or name in self._renewed:
                extent = self._extent(name, run)
                report.topics.append(self._compare(self._bag, now, name, self._tolerances, extent))
            elif name in now.topics and now.topics[name].count:
                count = now.topics[name].count
                report.notes.append(f"{name}: {count} messages now, and the recording has no such topic")
        if not report.topics and run.outputs:
            raise UsageError(
                f"{self._bag.path} has no output of {', '.join(one.node for one in run.nodes)}: "
                f"it publishes {', '.join(run.outputs)}; --accept writes what it says now into the recording"
            )
        if not report.topics:
            told = "; ".join(run.notes)
            raise UsageError(f"nothing of {', '.join(one.node for one in run.nodes)} can be compared: {told}")
        live = [topic.name for topic in report.topics if topic.name not in self._renewed]
        if live:
            report.notes.append(
                f"recorded from a live node: {', '.join(live)}; there, messages may come "
                f"{comparing.LIVE:g} s earlier or later where no tolerance says otherwise"
            )
        for pattern in self._tolerances.idle([topic.name for topic in report.topics]):
            report.notes.append(f"tolerances of {pattern} fit no topic that is compared")
        if not all(topic.same for topic in report.topics):
            report.verdict = "different"
        self._draw(now)
        return report

    def _outputs(self, run: RunResult) -> list[str]:
        """What these nodes say now, and what they said when the reference was made, or the recording."""
        found = dict.fromkeys(run.outputs)
        for one in run.nodes:
            mark = self._mark.get(one.node)
            found |= dict.fromkeys(mark.split() if mark is not None else run.said_then.get(one.node, ()))
        return list(found)

    def _extent(self, name: str, run: RunResult) -> Extent:
        if name in self._renewed:
            return Extent(exact=True)
        topic = self._bag.topics.get(name)
        latched = topic is not None and topic.qos.latched
        return Extent(exact=False, begin=run.first_input, end=self._bag.end, latched=latched)

    def _draw(self, now: Bag) -> None:
        if self._request.plots is None:
            return
        folder = Path(self._request.plots)
        for topic in self._report.topics:
            for field in topic.fields:
                if field.first.size is not None:
                    try:
                        path = draw(folder, topic.name, field.first, self._bag, now)
                    except RoboError as error:  # what was found is more than a picture of it
                        self._report.notes.append(f"{topic.name} {field.field} has no picture: {error}")
                        break
                    if path is not None:
                        self._report.plots.append(str(path))

    def _phase(self, run: RunResult) -> int | None:
        """When the nodes have to start for their timers to tick as they did when they were recorded."""
        phases: list[tuple[int, str, int, int]] = []
        timed = [name for name in run.periods if name in self._bag.topics]
        for name in timed:
            times = [message.published for message in self._bag.messages(name)]
            found = phase(times, run.periods[name])
            if found is not None:
                phases.append((len(times), name, *found))
        if phases:
            _, name, middle, scatter = max(phases)
            told = f"every {run.periods[name]:g} s, to within {scatter * 1e-6:.1f} ms"
            self._report.notes.append(f"timers tick as those of {name} were recorded, {told}")
            return start_before(self._bag.begin, middle, run.periods[name])
        if timed:
            self._report.notes.append(
                f"{', '.join(timed)}: it cannot be told when the timers ticked of which these come; they tick from the "
                "beginning of the recording on, and messages may differ for that alone; --accept makes a reference"
            )
        return None

    # -- a new reference ---------------------------------------------------------------------------------------------

    def _accept(self, run: RunResult, now: Bag) -> ReplayReport:
        report = self._report
        output = Path(self._request.output or self._request.bag)
        words = dict(self._mark) | {"begin": str(run.begin)} | {one.node: " ".join(one.outputs) for one in run.nodes}
        self._progress(0.0, f"writing {output}")
        renew(self._bag, now, self._outputs(run), {MARK: words}, output)
        report.verdict, report.accepted = "accepted", str(output)
        return report


def nodes_of(words: Sequence[str | type]) -> list[str]:
    """Nodes as `--node` names them; a class by its module.

    Raises:
        UsageError: a class stands in a function, where no other process finds it.
    """
    found = []
    for word in words:
        if isinstance(word, type):
            if "<locals>" in word.__qualname__:
                raise UsageError(f"{word.__qualname__} stands in a function; a replay needs a class of a module")
            word = f"{word.__module__}:{word.__qualname__}"
        found.append(word)
    return found
