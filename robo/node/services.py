"""A node's live ends of services: what `@service` and `Client` become.

A service is a queryable: the request is the query's payload, the answer its one reply, both MessagePack
(JSON requests are read too). It answers a query on exactly its key: one with wildcards calls nothing. An
exception in the handler goes back to the caller as an error reply.
"""

import itertools
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, Generic, Literal, TypeVar

import msgspec
import zenoh

import robo_messages
from robo.errors import ServiceError, ServiceTimeout
from robo.node.turn import Turn, name_of, paused, taking
from robo.wire import codec, queries
from robo.wire.codec import Decoder, Malformed
from robo.wire.keys import EndpointToken
from robo.wire.qos import DEFAULT_TIMEOUT, KEEP_ALL, Priority, QoS, zenoh_priority
from robo.wire.queries import Fault, QueryLoop
from robo.wire.targets import OF_ONE
from robo_messages import Message

Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)


def service_token(
    namespace: str,
    node: str,
    kind: Literal["srv", "cli"],
    request: type[Message],
    response: type[Message],
    key: str,
) -> EndpointToken:
    """The announcement of a service, or of a client of one."""
    return EndpointToken(
        namespace, node, kind, robo_messages.service_type_name(request, response), QoS(depth=KEEP_ALL), key
    )


class ServiceServer(Generic[Q, A]):
    """Answers the calls of one service, one at a time and in order, in turn with the node's callbacks."""

    def __init__(
        self,
        session: zenoh.Session,
        token: EndpointToken,
        request: type[Q],
        response: type[A],
        turn: Turn,
        handler: Callable[[Q], A],
        on_error: Callable[[BaseException], None],
    ) -> None:
        """`on_error` is told what the handler raised; the caller gets it as well."""
        self.key = token.topic
        self.announced = token
        self._decoder = Decoder(request)
        self._response = response
        self._encoding = codec.encoding_of(response)
        self._turn = turn
        self._handler = handler
        self._on_error = on_error
        self.served = 0
        """Calls answered."""
        self._loop = QueryLoop(session, self.key, self._answer, acts=[self.key])
        with ExitStack() as made:
            made.callback(self._loop.stop, 0.0)
            self._loop.start()
            self._token = session.liveliness().declare_token(token.key())
            made.pop_all()

    def stop(self, timeout: float) -> bool:
        """Take no more calls. Returns whether the handler came back within `timeout` seconds."""
        self._token.undeclare()
        return self._loop.stop(timeout)

    def _answer(self, query: zenoh.Query, key: str) -> None:
        payload = query.payload.to_bytes() if query.payload is not None else b"\x80"  # nothing is an empty map
        try:
            request = self._decoder.decode(payload, str(query.encoding))
        except Malformed as reason:
            queries.reply_error(query, Fault.of(reason))
            return
        try:
            with taking(self._turn, name_of(self._handler), self._loop.spare):
                answer = self._handler(request)
            if not isinstance(answer, self._response):
                raise TypeError(f"the handler returned {type(answer).__name__}, not {self._response.__name__}")
            queries.reply(query, key, answer, self._encoding)
        except BaseException as error:
            queries.reply_error(query, Fault.of(error))
            self._on_error(error)
        self.served += 1


class Presence:
    """Whether somebody answers on a key."""

    def __init__(self, session: zenoh.Session, key: str, on_leave: Callable[[], None] | None = None) -> None:
        """`on_leave` is called, on one of Zenoh's threads, when nobody does any more."""
        self._on_leave = on_leave
        self._present = threading.Event()
        self._watchers: list[Callable[[], None]] = []
        self.abandoned = False
        """Whether nobody is to wait any more: the node is told to stop."""
        self._querier = session.declare_querier(
            key,
            **OF_ONE,
        )
        with ExitStack() as made:
            made.callback(self._querier.undeclare)
            self._listener = self._querier.declare_matching_listener(self._notice)
            status: Any = self._querier.matching_status
            if status.matching:  # if not, what the listener has heard meanwhile is newer
                self._go_on()
            made.pop_all()

    def wait(self, timeout: float) -> bool:
        """Wait until somebody does. Returns whether somebody does, or nobody is to wait, within `timeout` seconds."""
        return self._present.wait(timeout)

    def tell(self, notice: Callable[[], None]) -> Callable[[], None]:
        """Call `notice` once `wait` would go on, at once if so already, in any thread. Returns what ends that."""
        self._watchers.append(notice)
        if self._present.is_set():
            notice()
        return lambda: self._watchers.remove(notice)

    @property
    def is_there(self) -> bool:
        """Whether somebody does."""
        return self._present.is_set()

    def abandon(self) -> None:
        """Let those that wait go on at once."""
        self.abandoned = True
        self._go_on()

    def close(self) -> None:
        """Look no more."""
        self._listener.undeclare()
        self._querier.undeclare()

    def _notice(self, status: Any) -> None:
        if status.matching or self.abandoned:
            self._go_on()
        elif self._present.is_set():
            self._present.clear()
            if self._on_leave is not None:
                self._on_leave()

    def _go_on(self) -> None:
        self._present.set()
        for notice in list(self._watchers):
            notice()


class ServiceClient(Generic[Q, A]):
    """Calls one service."""

    def __init__(
        self,
        session: zenoh.Session,
        token: EndpointToken,
        request: type[Q],
        response: type[A],
        timeout: float = DEFAULT_TIMEOUT,
        priority: Priority = "data",
    ) -> None:
        self.key = key = token.topic
        self.announced = token
        self._session = session
        self._encoding = codec.encoding_of(request)
        self._request = request
        self._decoder = Decoder(response)
        self._timeout = timeout
        self._priority = priority
        self._numbers = itertools.count(1)
        self._presence = Presence(session, key)
        with ExitStack() as made:
            made.callback(self._presence.close)
            self._token = session.liveliness().declare_token(token.key())
            made.pop_all()

    def __call__(self, request: Q, timeout: float | None = None) -> A:
        """Call the service and wait for its answer; other callbacks of the node may run meanwhile.

        Args:
            request: what to ask.
            timeout: how long to wait, s; by default what the client was made with.

        Raises:
            ServiceTimeout: nobody serves it, the server died, or it took longer.
            ServiceError: the handler raised; carries its message.
            TypeError: it is no request of this service.
        """
        self._check(request)
        with paused():
            return self._call(request, self._timeout if timeout is None else timeout)

    async def call_async(self, request: Q, timeout: float | None = None) -> A:
        """The same for async callbacks: `answer = await self.reset.call_async(Trigger.Request())`.

        It works in every loop of asyncio. Arguments and errors are those of the call.
        """
        from robo.node import async_calls  # asyncio is for nodes that use it

        self._check(request)
        granted = self._timeout if timeout is None else timeout
        left = await async_calls.appear(self._presence, self.key, granted)
        self._check_stop()
        begin = time.monotonic()
        request_, encoding = self._encoded(request), self._encoding
        answer = await async_calls.first_answer(self._session, self.key, request_, encoding, left, self._priority)
        return self._decode(_understood(self.key, answer, left, granted, begin))

    def wait_for_service(self, timeout: float) -> bool:
        """Wait until somebody serves it. Returns whether somebody does, within `timeout` seconds."""
        with paused():
            return self._presence.wait(timeout)

    def abandon(self) -> None:
        """Let calls that wait for a server fail at once: the node is told to stop."""
        self._presence.abandon()

    def close(self) -> None:
        """Leave the network."""
        self._token.undeclare()
        self._presence.close()

    def _check(self, request: object) -> None:
        if not isinstance(request, self._request):
            raise TypeError(f"{self.key} takes {robo_messages.type_name(self._request)}, not {type(request).__name__}")

    def _check_stop(self) -> None:
        if self._presence.abandoned:
            raise ServiceTimeout(f"service {self.key}: not called, this node is stopping")

    def _call(self, request: Q, timeout: float) -> A:
        begin = time.monotonic()
        if not self._presence.wait(timeout):
            raise ServiceTimeout(f"service {self.key}: nobody serves it (waited {timeout:g} s)")
        self._check_stop()
        left = max(timeout - (time.monotonic() - begin), 0.001)
        request_, encoding = self._encoded(request), self._encoding
        return self._decode(ask(self._session, self.key, request_, encoding, left, timeout, self._priority))

    def _encoded(self, request: Q) -> tuple[bytes, bytes]:
        attachment = codec.pack_attachment(next(self._numbers), time.time_ns())
        return msgspec.msgpack.encode(request), attachment

    def _decode(self, sample: zenoh.Sample) -> A:
        try:
            return self._decoder.decode(sample.payload.to_bytes(), str(sample.encoding))
        except Malformed as reason:
            raise ServiceError(f"service {self.key}: the answer is {reason}") from None


def ask(
    session: zenoh.Session,
    key: str,
    request: tuple[bytes, bytes],
    encoding: str,
    timeout: float,
    granted: float,
    priority: Priority = "data",
) -> zenoh.Sample:
    """Send one request, payload and attachment, and wait for its answer.

    Args:
        session: whose network to ask on.
        key: of the service.
        request: payload and attachment.
        encoding: of the payload.
        timeout: how long to wait, s.
        granted: what the caller was ready to wait in all, for the message.
        priority: of the request and of its answer.

    Raises:
        ReadOnly: there was no answer, for it is another user's robot, to look at.
        ServiceTimeout: there was no answer.
        ServiceError: the handler raised.
    """
    begin = time.monotonic()
    replies = session.get(
        key,
        payload=request[0],
        attachment=request[1],
        encoding=encoding,
        timeout=timeout,
        priority=zenoh_priority(priority),
        **OF_ONE,
    )
    answer = queries.first_answer(replies)
    if answer is None:
        from robo.wire import doors  # most callers never need to know

        doors.check(session, key.partition("/")[0], timeout)
    return _understood(key, answer, timeout, granted, begin)


def _understood(
    key: str, answer: zenoh.Sample | Fault | None, timeout: float, granted: float, begin: float
) -> zenoh.Sample:
    """The answer to what was asked at `begin`; raises as `ask`."""
    if isinstance(answer, Fault):
        raise ServiceError(f"service {key}: {answer.error}: {answer.message}", answer.error, answer.message)
    if answer is not None:
        return answer
    if time.monotonic() - begin < timeout * 0.9:
        raise ServiceTimeout(f"service {key}: its server, or the link to it, went away without an answer")
    raise ServiceTimeout(f"service {key} did not answer within {granted:g} s")
