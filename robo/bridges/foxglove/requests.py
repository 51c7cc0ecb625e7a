"""What clients ask for, and what becomes of it. Used by the event loop."""

import asyncio
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import TypeVar

import zenoh

from robo.bridges.foxglove import calls, protocol
from robo.bridges.foxglove.bridge import Bridge, tell_all_parameters
from robo.bridges.foxglove.client import MOST_STOPS, MOST_SUBSCRIPTIONS, Client, Subscription
from robo.bridges.foxglove.offered import ServedService
from robo.bridges.foxglove.protocol import (
    Advertise,
    Call,
    Control,
    GetParameters,
    Publish,
    Request,
    SetParameters,
    Subscribe,
    Unadvertise,
    Unsubscribe,
    UnwatchGraph,
    UnwatchParameters,
    Wanted,
    WatchGraph,
    WatchParameters,
)
from robo.dashboard.requests import RESET, STOP
from robo.errors import RoboError
from robo.text.brief import brief

T = TypeVar("T")

_MOST_WATCHED = 20_000
"""Parameters that one client may name."""


def ask(bridge: Bridge, client: Client, asked: Request) -> None:
    """Do what a client asks for; what takes a while is done beside."""
    if isinstance(asked, Advertise | Publish | Call | SetParameters | Control) and not client.drives:
        _refuse(client, asked, "this token is to look and not to drive")
        return
    match asked:
        case Subscribe(subscriptions):
            _subscribe(bridge, client, subscriptions)
        case Unsubscribe(subscription_ids):
            client.unsubscribe(subscription_ids)
            bridge.want()
        case Advertise(channels):
            for offered in channels:
                _publish(client, partial(client.publications.add, offered))
        case Unadvertise(channel_ids):
            for channel in channel_ids:
                _publish(client, partial(client.publications.remove, channel), always=True)
        case Publish(channel, data):
            now = time.monotonic()
            work = partial(client.publications.publish, channel, data, now, now - client.fresh)
            _publish(client, work, len(data))
        case WatchGraph():
            client.watch_graph(bridge.offer.ends, wants=True)
        case UnwatchGraph():
            client.watch_graph(bridge.offer.ends, wants=False)
        case WatchParameters(names):
            _watch(client, names)
            bridge.watch()
        case UnwatchParameters(names):
            client.watched = (client.watched or set()) - {*names} if names else set()
            bridge.watch()
        case GetParameters() | SetParameters() | Call() | Control():
            _later(bridge, client, asked)


def _subscribe(bridge: Bridge, client: Client, subscriptions: Sequence[Wanted]) -> None:
    late: list[Wanted] = []
    for wanted in subscriptions:
        if wanted.channel_id not in bridge.offer.topics:
            client.status(protocol.WARNING, f"there is no topic with the number {wanted.channel_id} any more")
        elif wanted.id in client.subscriptions:
            client.status(protocol.WARNING, f"subscription {wanted.id} is there already")
        elif len(client.subscriptions) >= MOST_SUBSCRIPTIONS:
            client.status(protocol.ERROR, f"one viewer subscribes {MOST_SUBSCRIPTIONS:,} topics at most")
        else:
            client.subscriptions[wanted.id] = Subscription(wanted.channel_id)
            late.append(wanted)
    bridge.want()  # before the past is asked for, so that nothing falls between
    for wanted in late:
        topic = bridge.offer.topics[wanted.channel_id]
        if topic.latched:
            bridge.say_again([(client, wanted.id)], topic)


def _watch(client: Client, names: Sequence[str]) -> None:
    if not names:
        client.watched = None
    elif client.watched is not None and len(client.watched) + len(names) <= _MOST_WATCHED:
        client.watched |= {*names}
    elif client.watched is not None:
        client.status(protocol.ERROR, f"one viewer watches {_MOST_WATCHED:,} parameters at most")


def _publish(client: Client, work: Callable[[], None], size: int = 0, *, always: bool = False) -> None:
    """Have something published, in order, without waiting for the network; what is to be done `always`, though much
    waits for it.
    """
    if not client.publishing.do(work, size, always=always):
        client.status(protocol.WARNING, "the network is held up: what this viewer publishes is left out", "publish")


def _later(bridge: Bridge, client: Client, asked: GetParameters | SetParameters | Call | Control) -> None:
    """Have something done that waits for others. Emergency stops are counted apart: no question is in their way."""
    service = bridge.service(asked.service) if isinstance(asked, Call) else None
    stops = service.key if service is not None and calls.is_stop(service) else ""
    _end_grips(bridge, service)
    if stops and client.stops[stops] >= MOST_STOPS:
        _refuse(client, asked, "it is being asked for already", service)
        return
    if not stops and client.asked >= client.most_asked:
        _refuse(client, asked, f"{client.most_asked} questions of this viewer wait for an answer already", service)
        return
    client.stops.update([stops] if stops else [])
    client.asked += not stops

    async def work() -> None:
        try:
            if isinstance(asked, Call):
                await _call(bridge, client, asked)
            else:
                await _done(bridge, client, asked)
        except (RoboError, zenoh.ZError, LookupError) as error:
            _refuse(client, asked, brief(str(error)), service)
        except Exception as error:  # nobody has thought of it: the viewer that waits is told all the same
            _refuse(client, asked, brief(f"the bridge has failed: {type(error).__name__}: {error}"), service)
        finally:
            client.stops -= Counter([stops] if stops else [])
            client.asked -= not stops
            _end_grips(bridge, service)  # those as well that began while the robot was stopped

    bridge.do(work())


def _end_grips(bridge: Bridge, service: ServedService | None) -> None:
    """Where a robot is to stop, or was stopped and may move again, whoever holds it must take hold anew."""
    if service is not None:
        robot, _, name = service.key.rpartition("/")
        if name in (STOP, RESET):
            bridge.driving.drivers.end(robot, time.monotonic())


async def _call(bridge: Bridge, client: Client, asked: Call) -> None:
    service = bridge.offer.services.get(asked.service)
    if service is None:
        raise LookupError("this service is not there any more")
    if calls.is_stop(service):
        answer = calls.stop_answer(asked, await bridge.driving.stops.stop(service.key))
    else:
        work = partial(calls.call, bridge.session, asked, service)
        answer = await asyncio.get_running_loop().run_in_executor(bridge.pools.calls, work)
    client.say(protocol.answer(asked, answer))


async def _done(bridge: Bridge, client: Client, asked: GetParameters | SetParameters | Control) -> None:
    loop = asyncio.get_running_loop()

    def blocking(work: Callable[[], T]) -> Awaitable[T]:
        return loop.run_in_executor(bridge.pools.calls, work)

    match asked:
        case Control():
            place = await blocking(partial(bridge.playback.control, asked))
            if asked.seek is not None:
                bridge.say_all_again_soon()
            state = place.state(asked.request, jumped=asked.seek is not None)
            others = place.state(jumped=asked.seek is not None)
            for one in bridge.clients:
                if one.knows_playback:
                    one.say(state if one is client else others)
        case GetParameters([], id_):
            client.wants_all_parameters = True
            await tell_all_parameters(bridge, client, id_)
        case GetParameters(names, id_):
            await _tell_some(bridge, client, names, id_)
        case SetParameters(parameters, id_):
            wrong = await blocking(partial(calls.set_parameters, bridge.session, parameters, bridge.covers))
            for why in wrong:
                client.status(protocol.ERROR, brief(why))
            if id_ is not None or wrong:  # what holds: a viewer shows already what it has asked for
                await _tell_some(bridge, client, [one.name for one in parameters], id_)


async def _tell_some(bridge: Bridge, client: Client, names: Sequence[str], id_: str | None) -> None:
    work = partial(calls.some_parameters, bridge.session, names, bridge.covers)
    found, wrong = await asyncio.get_running_loop().run_in_executor(bridge.pools.calls, work)
    for why in wrong:
        client.status(protocol.WARNING, brief(why))
    named = {"id": id_} if id_ is not None else {}
    client.say(protocol.word("parameterValues", parameters=found, **named))


def _refuse(client: Client, asked: Request, why: str, service: ServedService | None = None) -> None:
    """Tell a client that something is not done.

    Args:
        client: who has asked.
        asked: what.
        why: not.
        service: that was called, where it is known.
    """
    if isinstance(asked, Call):
        answer = calls.refusal(asked, service, why) if service is not None else None
        if answer is not None:
            # Lichtblick waits for ever where it is told of a failure, and its button is dead.
            client.say(protocol.answer(asked, answer))
        else:
            words = {"serviceId": asked.service, "callId": asked.call, "message": why}
            client.say(protocol.word("serviceCallFailure", **words))
    # Not all viewers show why a call has failed; what all show is this.
    client.status(protocol.ERROR, why, "refused" if isinstance(asked, Publish) else "")
