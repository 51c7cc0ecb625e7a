"""`robo bag play`: what is told before, while and after a recording is played, and who steers it."""

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

import zenoh

from robo import bag
from robo.bag.of_robot import robots_of
from robo.bag.read.reader import Bag, Order
from robo.cli.connection import connect_to_robot, see_that_it_obeys
from robo.cli.link import Link
from robo.cli.printing import amount, hint, note, print_json, print_line
from robo.cli.reach import Reach
from robo.cli.views.bag_keys import FAR, SEEK, Decoder, Key, far_away, next_rate, status_line
from robo.errors import BagError, DamagedBag, InvalidName, UsageError
from robo.recording.play.outputs import ClockOutput, Outputs
from robo.recording.play.player import Player
from robo.recording.play.services import PlayerServices
from robo.recording.play.tape import BagTape, Window
from robo.recording.play.timeline import check_clock_rate, check_rate
from robo.recording.play.topics import CLOCK, Choice, Played, Selection, select
from robo.samples.publishing import Audience
from robo.text.brief import brief
from robo.text.keyboard import KeyboardTerminal, NoTerminal
from robo.tools import topics
from robo.wire import names
from robo.wire.discovery import tokens
from robo.wire.keys import EndpointToken

if TYPE_CHECKING:  # what a verb does is apart from how it is called
    from robo.cli.play_words import PlayWords

NAME = "bag_player"
"""Of the player, within the robot's namespace; a second one has a number."""

_LOOK = 0.1
"""How often it is looked what to draw, s."""
_FOUND = 1.0
"""How long it may take until Zenoh has found those who listen, s: what is published sooner would miss them."""
_LAST = 1.0
"""How long the last message may take, s: a receiver that wants all of them may hang."""
_LONGEST_DELAY = 86_400.0
"""s."""
_LATE = 0.1
"""From how late it is told, s."""
_MOST_TOLD = 10
"""Notes of one kind."""


def play(path: str, reach: Reach, words: "PlayWords", *, json: bool) -> int:
    """Play a recording.

    Returns:
        1 where something could not be read; the rest was played.

    Raises:
        UsageError: the words make no sense, or nothing in the recording fits them.
        BagError: it cannot be read, or nothing in it can be played.
        DamagedBag: a part of it is damaged; what comes before it was played.
        TopicTaken: somebody publishes a topic already.
        RoboError: nothing runs.
    """
    check_rate(words.rate)
    check_clock_rate(words.clock_rate)
    if not 0 <= words.delay <= _LONGEST_DELAY:  # NaN too
        raise UsageError(f"--delay {words.delay:g}: use 0 to {_LONGEST_DELAY:g} s")
    with bag.open(path) as recording, ExitStack() as ends:
        _tell_all(f"{fault}; what can be read is played, and `robo bag recover` mends it" for fault in recording.faults)
        choice = Choice(words.topics or (), words.exclude or (), words.remap or (), reach.namespace)
        selection = select(recording.topics, choice, recording.path, robots_of(recording))
        tape = _tape(recording, selection.played, words)  # a mistake is told before anything is dialled
        session = ends.enter_context(connect_to_robot(reach))
        see_that_it_obeys(session, reach, selection.played[0].key if selection.played else "")
        listening = _refuse_taken(session, selection.played, words, reach)
        run = _Run(session, recording, tape, selection, words, reach, json=json)
        run.play(listening)
    return 1 if recording.faults or tape.converter.unreadable else 0


def _tape(recording: Bag, played: list[Played], words: "PlayWords") -> BagTape:
    order: Order = "published" if words.order in ("published", "sent") else "arrived"
    try:
        return BagTape(recording, played, order, Window(words.start, words.end, words.duration))
    except DamagedBag:
        hint("`robo bag recover` makes a recording of all that can be read")
        raise


def _refuse_taken(session: zenoh.Session, played: list[Played], words: "PlayWords", reach: Reach) -> list[str]:
    """Refuse what is not to be published. Returns the topics to which somebody listens.

    Raises:
        MessageError: nodes know one as another type.
        TopicTaken: somebody publishes one already.
    """
    wanted = {one.key: one.type or one.topic.schema or "bytes" for one in played}
    if _tells_time(played, words):
        wanted[CLOCK] = "system/Clock"
    there = topics.among(session, wanted, reach.timeout)
    for topic in there:
        if not words.force:
            topics.refuse_type(topic, wanted[topic.key])
        if not words.beside:
            topics.refuse_taken(topic, "--exclude leaves it out, --remap and --robot-name play it elsewhere")
    return [topic.key for topic in there if topic.subscribers]


def _tells_time(played: list[Played], words: "PlayWords") -> bool:
    """Whether to tell the time: a recording that has a clock tells it itself."""
    return (words.clock or words.clock_rate is not None) and all(one.key != CLOCK for one in played)


def _as_namespace(robot: str) -> str:
    """The recorded robot, if nodes may be called so."""
    try:
        return names.normalize_namespace(robot)
    except InvalidName:
        return ""


def _free_name(session: zenoh.Session, namespace: str, timeout: float) -> str:
    """A full name that no other player has."""
    there = {token.full_name for token in tokens(session, timeout) if isinstance(token, EndpointToken)}
    wanted = names.absolute(NAME, namespace)
    number = 1
    while (name := f"{wanted}_{number}" if number > 1 else wanted) in there:
        number += 1
    return name


class _Run:
    """One recording that is played."""

    def __init__(
        self,
        session: zenoh.Session,
        recording: Bag,
        tape: BagTape,
        selection: Selection,
        words: "PlayWords",
        reach: Reach,
        *,
        json: bool,
    ) -> None:
        self._session = session
        self._recording = recording
        self._tape = tape
        self._selection = selection
        self._words = words
        self._reach = reach
        self._json = json
        self._link = Link(session, reach)
        self._link_due = 0.0
        self._told_far_away = False
        self._terminal: KeyboardTerminal | None = None
        self._over = threading.Event()
        self._complete = False
        self._error: BaseException | None = None

    def play(self, listening: list[str]) -> None:
        """Play it, and tell of it.

        Args:
            listening: topics to which somebody listens.
        """
        words, session, played = self._words, self._session, self._selection.played
        namespace = self._reach.namespace or _as_namespace(self._selection.robot)
        with ExitStack() as ends:
            ends.enter_context(_ends_on_sigterm())
            node = _free_name(session, namespace, self._reach.timeout)
            self._tell_beginning(node)
            outputs = ends.enter_context(closing(Outputs(session, played, node)))
            clock = None
            if _tells_time(played, words):
                clock = ends.enter_context(closing(ClockOutput(session, node)))
            elif words.clock or words.clock_rate is not None:
                note("the recording has a /clock of its own, which is played: --clock adds none")
            self._wait_for_subscribers(listening)
            player = Player(
                self._tape,
                outputs,
                rate=words.rate,
                paused=words.start_paused,
                loop=words.loop,
                clock=clock,
                clock_period=1.0 / words.clock_rate if words.clock_rate else None,
                on_change=self._wake,
            )
            ends.enter_context(closing(player))
            ends.enter_context(closing(PlayerServices(session, player, node, player.stop)))
            begin = time.monotonic()
            try:
                self._run(player)
                if self._complete:
                    outputs.arrive()
            finally:
                self._tell_end(player, outputs, time.monotonic() - begin)
            if isinstance(self._error, DamagedBag):
                hint("what comes before it was played; `robo bag recover` makes a recording of all that can be read")
            if self._error is not None:
                raise self._error
            if self._complete and not player.played and not self._tape.converter.unreadable:
                self._refuse_nothing()

    def _run(self, player: Player) -> None:
        """Play in a thread of its own, and look after keys and the link meanwhile."""
        thread = threading.Thread(target=self._play, args=(player,), name="robo-play", daemon=True)
        try:
            with self._keys() as self._terminal:
                thread.start()
                while not (self._over.is_set() or player.stopped):
                    self._attend(player)
        finally:
            player.stop()
            thread.join(_LAST)

    def _play(self, player: Player) -> None:
        try:
            self._complete = player.run()
        except BaseException as error:  # it is told by whoever waits
            self._error = error
        self._over.set()
        self._wake()

    def _wake(self) -> None:
        if self._terminal is not None:
            self._terminal.wake()

    @contextmanager
    def _keys(self) -> Iterator[KeyboardTerminal | None]:
        """The terminal, where there is one and its keys are wanted; whatever happens, it is given back."""
        terminal = None
        if not (self._words.no_keys or self._json):
            with suppress(NoTerminal):
                terminal = KeyboardTerminal(screen=False)
        if terminal is None:
            yield None
            return
        self._decoder = Decoder()
        try:
            terminal.watch_signals()
            terminal.enter()
            yield terminal
        finally:
            self._terminal = None
            _draw(terminal, "")
            terminal.close()

    def _attend(self, player: Player) -> None:
        terminal, state = self._terminal, player.state
        if time.monotonic() >= self._link_due:
            self._link_due = time.monotonic() + 3 * _LOOK
            if changed := self._link.look():
                self._note(changed)
        if not self._told_far_away and (text := far_away(state)) is not None:
            self._told_far_away = True
            self._note(f"{text}; {'n goes to the next message' if terminal is not None else '--start goes beyond it'}")
        if terminal is None:
            self._over.wait(_LOOK)
            return
        _draw(terminal, status_line(state, self._tape.first, self._tape.end, terminal.size.columns))
        heard = terminal.wait(_LOOK)
        if heard.closed:
            player.stop()
        elif heard.suspend:
            _draw(terminal, "")
            terminal.suspend()
        for key in self._decoder.keys(heard.data):
            _press(key, player)

    def _note(self, text: str) -> None:
        if self._terminal is not None:
            _draw(self._terminal, "")
        note(text)

    def _wait_for_subscribers(self, listening: list[str]) -> None:
        """Wait for those that are there already until Zenoh has found them, or, if that is wanted, for all."""
        with closing(Audience(self._session, listening)) as audience:
            audience.wait(_FOUND)
        if self._words.wait_for_subscribers:
            keys = dict.fromkeys(one.key for one in self._selection.played)
            with closing(Audience(self._session, keys)) as audience:
                told: list[str] = []
                while not audience.wait(_LOOK):
                    if told != audience.missing:
                        told = audience.missing
                        missing = ", ".join(told)
                        hint(f"waiting for a subscriber of {missing} … (--topics and --exclude say which are played)")
        time.sleep(self._words.delay)

    def _tell_beginning(self, node: str) -> None:
        played, tape = self._selection.played, self._tape
        _tell_all(
            f"{brief(one, 100)} is not played: it is no name of a topic; --remap OLD:=NEW gives another one"
            for one in self._selection.nameless
        )
        if left := self._selection.left:
            told = ", ".join(brief(one, 100) for one in left[:_MOST_TOLD])
            note(f"not played, for nodes that run say it of themselves: {told}; --topics plays what it names")
        _tell_all(f"{one.key} is published as {one.encoding}: {one.topic.unknown}" for one in played if not one.type)
        if self._json:
            about = [
                {"topic": one.topic.name, "key": one.key, "type": one.topic.type, "encoding": one.encoding}
                for one in played
            ]
            begin, end = tape.begin, tape.end
            path = self._recording.path
            print_json({"event": "begin", "path": path, "node": node, "begin": begin, "end": end, "topics": about})
            return
        recorded, robot = self._selection.robot, self._reach.namespace
        renamed = f", {recorded} as {robot}" if recorded and robot and recorded != robot else ""
        window = f"{(tape.begin - tape.first) * 1e-9:.1f} to {(tape.end - tape.first) * 1e-9:.1f} s"
        print_line(f"playing {self._recording.path}: {amount(len(played), 'topic')}, {window}{renamed}; {node}")

    def _refuse_nothing(self) -> NoReturn:
        tape, played = self._tape, self._selection.played
        names_of = ", ".join(brief(one.topic.name, 100) for one in played[:_MOST_TOLD])
        begin, end = ((at - tape.first) * 1e-9 for at in (tape.begin, tape.end))
        raise BagError(f"no message of {names_of} is between {begin:g} and {end:g} s", self._recording.path)

    def _tell_end(self, player: Player, outputs: Outputs, seconds: float) -> None:
        unreadable = dict(self._tape.converter.unreadable)
        if unreadable:
            total = sum(unreadable.values())
            note(f"{amount(total, 'message')} left out, which cannot be read; the first: {self._tape.converter.reason}")
        if player.latest > _LATE and self._words.rate:
            note(f"messages were up to {player.latest:.1f} s late: who wants all of them, or this machine, is slow")
        if self._json:
            counts: dict[str, int] = {}
            for one, count in zip(outputs.played, outputs.counts, strict=True):
                counts[one.key] = counts.get(one.key, 0) + count
            facts = {"messages": player.played, "seconds": seconds, "complete": self._complete, "late": player.latest}
            print_json({"event": "end", **facts, "unreadable": unreadable, "topics": counts})
            return
        how = "played" if self._complete else "stopped:"
        print_line(f"{how} {player.played:,} messages in {seconds:.1f} s")


def _press(key: Key, player: Player) -> None:
    match key:
        case "pause":
            player.toggle()
        case "step":
            player.step()
        case "next":
            player.hurry()
        case "ahead" if player.state.paused:
            player.step()
        case "ahead":
            player.skip(SEEK)
        case "back":
            player.skip(-SEEK)
        case "far ahead":
            player.skip(FAR)
        case "far back":
            player.skip(-FAR)
        case "faster" | "slower":
            player.change_rate(next_rate(player.state.rate, faster=key == "faster"))
        case "quit":
            player.stop()


def _draw(terminal: KeyboardTerminal, text: str) -> None:
    """Show a line in the place of the former one."""
    if terminal.is_ours:
        terminal.write(f"\r\x1b[K{text}")


def _tell_all(lines: Iterator[str]) -> None:
    told = list(lines)
    for line in told[:_MOST_TOLD]:
        note(line)
    if len(told) > _MOST_TOLD:
        note(f"… and {len(told) - _MOST_TOLD} more")


@contextmanager
def _ends_on_sigterm() -> Iterator[None]:
    """Whoever ends this program finds the terminal as it was, and topics given up."""

    def leave(_number: int, _frame: FrameType | None) -> NoReturn:
        sys.exit(128 + signal.SIGTERM)

    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
