"""All pages that are open: what each is told, and what each asks for. Used by one thread, that of the event loop."""

import asyncio
import itertools
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from typing import TypeGuard

import msgspec
import zenoh

from robo.dashboard import clock, protocol, requests
from robo.dashboard.delivery import Delivery, Page, is_robot
from robo.dashboard.driver import Driver
from robo.dashboard.lease import MOST_AGE
from robo.dashboard.protocol import (
    Call,
    Command,
    Drive,
    Parameters,
    Publish,
    Read,
    Release,
    Request,
    Set,
    Watch,
)
from robo.dashboard.state import Line, Picture
from robo.dashboard.stops import Stops
from robo.dashboard.topics import Message, Topics
from robo.errors import RoboError
from robo.web.access import Right
from robo.wire.reports import Event

BEAT = 0.1
"""How often a page hears that the server lives, s."""
_MOST_PAGES, _FOR_DRIVERS = 50, 10
_MOST_ASKED, _MOST_LOOKS = 40, 4
"""Answers that one page may wait for, or have not read; and one that may only look."""
_PAST = 500
"""Lines and events for a page that is opened."""
_MOST_LINEAR, _MOST_ANGULAR = 10.0, 20.0
"""What a page may ask for, m/s and rad/s: the robot's own limits are tighter."""


_Blocking = Call | Publish | Command | Parameters | Set


class Hub:
    """Knows all pages."""

    def __init__(
        self, session: zenoh.Session, topics: Topics, driver: Driver, calls: Executor, looks: Executor, stops: Stops
    ) -> None:
        """
        Args:
            session: the network.
            topics: what pages watch.
            driver: by which they drive.
            calls: does what blocks.
            looks: does what those ask for who may only look.
            stops: has robots stop, and waits for nothing else.
        """
        self._session, self._driver = session, driver
        self._calls, self._looks, self._stops = calls, looks, stops
        self._pages: set[Page] = set()
        self._numbers = itertools.count(1)
        self._delivery = Delivery(topics, self._pages)
        self._picture: Picture | None = None
        self._lines: list[Line] = []
        self._events: list[Event] = []
        self._drivers = driver.drivers()
        self._tasks: set[asyncio.Task[None]] = set()

    def is_full(self, right: Right) -> bool:
        """Whether no more pages of a right fit: those that look leave room for some that drive."""
        return len(self._pages) >= (_MOST_PAGES if right is Right.DRIVE else _MOST_PAGES - _FOR_DRIVERS)

    async def close(self) -> None:
        """Wait for nothing any more that pages have asked for."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @property
    def has_pages(self) -> bool:
        """Whether anybody looks."""
        return bool(self._pages)

    def join(self, right: Right) -> Page:
        """A page has been opened."""
        page = Page(next(self._numbers), right)
        page.tell("welcome", name=page.name, drives=right is Right.DRIVE)
        if self._picture is not None and self._pages:  # else it is an old one, and a new one is on its way
            page.tell("picture", newest="picture", picture=self._picture)
        page.tell("lines", lines=self._lines)
        page.tell("events", events=self._events)
        page.tell("drivers", newest="drivers", urgent=True, **msgspec.structs.asdict(self._drivers))
        self._pages.add(page)
        return page

    def leave(self, page: Page) -> None:
        """A page is gone, or cannot be heard any more."""
        self._pages.discard(page)
        self._driver.leave(page.name)
        self._delivery.forget()

    def looked(self, picture: Picture) -> None:
        """What runs."""
        self._picture = picture
        self._tell_all("picture", newest="picture", picture=picture)

    def lines(self, lines: list[Line]) -> None:
        """New lines of logs."""
        self._lines = sorted([*self._lines, *lines], key=lambda one: one.time)[-_PAST:]  # of the past some come late
        self._tell_all("lines", lines=lines)

    def events(self, events: list[Event]) -> None:
        """New events."""
        self._events = sorted([*self._events, *events], key=lambda one: one.time)[-_PAST:]
        self._tell_all("events", events=events)

    def messages(self, messages: list[Message]) -> None:
        """What has come on topics that pages watch."""
        self._delivery.messages(messages)

    def beat(self) -> None:
        """Tell every page that the server lives, who drives, and where frames stand that have moved."""
        now = clock.steady()
        self._tell_drivers()
        for page in self._pages:
            left = {"left_out": page.mailbox.left_out} if page.mailbox.left_out else {}
            page.tell("beat", newest="beat", urgent=True, number=page.beats.next(now), time=clock.now() / 1e6, **left)

        self._delivery.tell_frames()

    def ask(self, page: Page, asked: Request) -> None:
        """What a page asks for."""
        if protocol.needs_driver(asked) and page.right is not Right.DRIVE:
            page.tell("refused", id=getattr(asked, "id", None), reason="this page may look and not drive")
            return
        match asked:
            case Read():
                page.mailbox.has_read(asked.count)
                page.wake.set()
            case Watch():
                self._delivery.watch(page, asked.keys, asked.frames)
            case Drive():
                self._drive(page, asked)
            case Release():
                self._driver.leave(page.name)
            case _:
                self._do(page, asked)

    def _work(self, asked: _Blocking) -> Callable[[], object]:
        """What answers a page, and blocks."""
        match asked:
            case Call():
                return partial(requests.call, self._session, asked.service, asked.type, asked.request)
            case Publish():
                return partial(requests.publish, self._session, asked.topic, asked.type, asked.message)
            case Command():
                return partial(requests.command, self._session, asked.robot, asked.verb, asked.node)
            case Parameters():
                return partial(requests.all_parameters, self._session, asked.node)
            case Set():
                return partial(requests.set_parameters, self._session, asked.node, asked.values)

    def _drive(self, page: Page, asked: Drive) -> None:
        if not is_robot(asked.robot):
            page.tell("refused", newest="refused", urgent=True, reason="that is no name of a robot")
            return
        age = page.beats.age(asked.heard, asked.since, clock.steady())
        if age > MOST_AGE:
            reason = f"a command is {1e3 * min(age, 99):.0f} ms old"
            page.tell("refused", newest="refused", urgent=True, reason=reason, late=True)
            self._driver.hold(asked.robot, page.name)
            return
        if not (abs(asked.linear) <= _MOST_LINEAR and abs(asked.angular) <= _MOST_ANGULAR):  # NaN neither
            page.tell("refused", newest="refused", urgent=True, reason="so fast drives no robot")
            return
        refusal = self._driver.command(asked.robot, page.name, asked.linear, asked.angular, asked.grip)
        if refusal:
            page.tell("refused", newest="refused", urgent=True, reason=refusal)

    def _tell_drivers(self) -> None:
        """Tell pages who drives, and whose grips have been ended, where that is news."""
        drivers = self._driver.drivers()
        if drivers != self._drivers:
            self._drivers = drivers
            self._tell_all("drivers", newest="drivers", urgent=True, **msgspec.structs.asdict(drivers))

    def _tell_all(self, kind: str, *, newest: str = "", urgent: bool = False, **what: object) -> None:
        if not self._pages:
            return  # nothing need be put into words
        data = protocol.news(kind, **what)
        for page in self._pages:
            page.hand(data, newest=newest, urgent=urgent)

    def _do(self, page: Page, asked: _Blocking) -> None:
        """Have something done that blocks, by a thread; the page is told what came of it."""
        stops = _is_call(asked, requests.STOP)
        self._end_grips(asked)
        if isinstance(asked, Publish):  # a waypoint moves a robot, too
            robot = asked.topic.rpartition("/")[0]
            if (other := self._driver.other(robot, page.name)) is not None:
                page.tell("refused", id=asked.id, reason=f"{other} drives {robot}")
                return
        most = _MOST_ASKED if page.right is Right.DRIVE else _MOST_LOOKS
        waiting = page.stops if stops else page.asked + page.mailbox.urgent
        if waiting >= most:
            reason = "too much is asked for at once"
            if page.mailbox.urgent < 2 * _MOST_ASKED:  # beyond that it reads nothing anyway
                page.tell("refused", newest=f"answer {asked.id}", urgent=True, id=asked.id, reason=reason)
            return
        page.asked += not stops
        page.stops += stops
        task = asyncio.get_running_loop().create_task(self._done(page, asked, stops=stops))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _end_grips(self, asked: _Blocking) -> None:
        """Where a robot is to stop, or was stopped and may move again, whoever holds it must take hold anew."""
        if _is_call(asked, requests.STOP) or _is_call(asked, requests.RESET):
            self._driver.end(asked.service.rpartition("/")[0])
            self._tell_drivers()

    async def _done(self, page: Page, asked: _Blocking, *, stops: bool) -> None:
        number, name = asked.id, f"answer {asked.id}"
        executor = self._calls if page.right is Right.DRIVE else self._looks
        try:
            if stops:
                assert isinstance(asked, Call)
                answer = await self._stops.stop(asked.service)
            else:
                answer = await asyncio.get_running_loop().run_in_executor(executor, self._work(asked))
            page.tell("answer", newest=name, urgent=True, id=number, answer=answer)
        except (RoboError, zenoh.ZError) as error:
            page.tell("refused", newest=name, urgent=True, id=number, reason=str(error))
        except Exception as error:  # nobody has thought of it: the page that waits is told all the same
            reason = f"the dashboard has failed: {type(error).__name__}: {error}"
            page.tell("refused", newest=name, urgent=True, id=number, reason=reason)
        finally:
            page.asked -= not stops
            page.stops -= stops
            self._end_grips(asked)  # those as well that began while the robot was stopped


def _is_call(asked: _Blocking, service: str) -> TypeGuard[Call]:
    """Whether a robot's service of this last name is called."""
    return isinstance(asked, Call) and asked.service.rpartition("/")[2] == service
