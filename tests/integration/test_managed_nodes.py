"""Managed nodes: what works in which state, what errors lead to, and ROS's services and topic on the wire."""

import asyncio
import threading
import time
from collections.abc import Callable
from typing import Annotated

import msgpack
import pytest
import zenoh
from msgspec import Meta

import robo
from robo import (
    KEEP_ALL,
    ContractError,
    LifecycleError,
    LifecycleNode,
    LifecycleState,
    Node,
    Publisher,
    ServiceError,
    TransitionCallbackReturn,
    service,
    subscribe,
    timer,
)
from robo.testing import Clock, NotThere, RunNode
from robo.wire.discovery import tokens
from robo.wire.keys import NodeToken
from robo_messages import (
    ChangeState,
    GetAvailableStates,
    GetAvailableTransitions,
    GetState,
    String,
    TransitionEvent,
    Trigger,
)
from tests.plain import hear, samples
from tests.support import PATIENCE, eventually

SUCCESS, FAILURE, ERROR = TransitionCallbackReturn
HOOKS = ["on_configure", "on_activate", "on_deactivate", "on_cleanup", "on_shutdown", "on_error"]


class Camera(LifecycleNode):
    """Notes what is called, and does in each hook what a test wants."""

    class Parameters(robo.Parameters):
        rate: Annotated[float, Meta(gt=0)] = 10.0

    parameters: Parameters

    image = Publisher(String, "image")
    seen = Publisher(String, "seen")

    def __init__(self, **keywords: object) -> None:
        super().__init__(**keywords)  # type: ignore[arg-type]
        self.called: list[str] = []
        self.acts: dict[str, Callable[[], TransitionCallbackReturn | None]] = {}

    def _hook(self, name: str) -> TransitionCallbackReturn | None:
        self.called.append(name)
        self.image.publish(String(name))
        return self.acts.get(name, lambda: None)()

    def on_configure(self) -> TransitionCallbackReturn | None:
        return self._hook("on_configure")

    def on_activate(self) -> TransitionCallbackReturn | None:
        return self._hook("on_activate")

    def on_deactivate(self) -> TransitionCallbackReturn | None:
        return self._hook("on_deactivate")

    def on_cleanup(self) -> TransitionCallbackReturn | None:
        return self._hook("on_cleanup")

    def on_shutdown(self) -> TransitionCallbackReturn | None:
        return self._hook("on_shutdown")

    def on_error(self) -> TransitionCallbackReturn | None:
        self.called.append(f"on_error from {self.state_before}")
        return self.acts.get("on_error", super().on_error)()

    def on_stop(self) -> None:
        self.called.append("on_stop")

    @timer(rate="rate")
    def tick(self) -> None:
        self.image.publish(String("tick"))

    @subscribe("order")
    def on_order(self, order: String) -> None:
        self.seen.publish(order)

    @subscribe("map", latched=True, depth=1)
    def on_map(self, map_: String) -> None:
        self.seen.publish(map_)

    @service("snap")
    def snap(self, _: Trigger.Request) -> Trigger.Response:
        return Trigger.Response(message=str(self.lifecycle_state))


def fails() -> TransitionCallbackReturn:
    return FAILURE


def breaks() -> TransitionCallbackReturn:
    raise OSError("no device")


def succeeds() -> TransitionCallbackReturn:
    return SUCCESS


def test_a_node_comes_to_active_by_itself_and_goes_all_the_way_down_at_its_end(run_node: RunNode) -> None:
    camera = run_node(Camera)
    assert camera.node.called == ["on_configure", "on_activate"]
    assert camera.node.status.lifecycle == "active"
    camera.close()
    assert camera.node.called[2:] == ["on_deactivate", "on_cleanup", "on_shutdown", "on_stop"]
    assert camera.node.lifecycle_state == LifecycleState.FINALIZED
    # From the beginning of on_activate to the end of on_deactivate it publishes.
    assert [one.data for one in camera.published("image")] == ["on_activate", "on_deactivate"]


def test_a_test_may_take_each_step_itself(run_node: RunNode, clock: Clock) -> None:
    camera = run_node(Camera, autostart=False)
    assert camera.node.called == []
    clock.advance(1.0)
    assert camera.change_state("configure")
    camera.send("order", String("too early"))
    clock.advance(1.0)
    assert camera.published("image") == camera.published("seen") == []
    assert camera.change_state("activate")
    camera.send("order", String("now"))
    clock.advance(0.2)
    assert [one.data for one in camera.published("seen")] == ["now"]
    assert [one.data for one in camera.published(Camera.image)] == ["on_activate", "tick", "tick"]
    assert camera.change_state("deactivate")
    camera.clear()
    clock.advance(1.0)
    assert camera.published("image") == []
    with pytest.raises(LifecycleError, match="it is inactive and cannot deactivate; it can cleanup or activate or"):
        camera.change_state("deactivate")


def test_a_call_of_a_node_that_is_not_active_gets_an_error_at_once(run_node: RunNode) -> None:
    camera = run_node(Camera, autostart=False)
    with pytest.raises(ServiceError, match="NotActive: the node is unconfigured; it answers while it is active"):
        camera.call("snap", Trigger.Request())
    camera.change_state("configure")
    camera.change_state("activate")
    assert camera.call("snap", Trigger.Request()).message == "active"
    assert camera.node.status.callback_errors == 0, "a call that is refused is no trouble of the node's"


def test_parameters_change_in_every_state(run_node: RunNode) -> None:
    camera = run_node(Camera, autostart=False)
    camera.set(rate=2.0)
    assert camera.node.parameters.rate == 2.0


class Mapper(Node):
    """Tells what it is told, for whoever comes later too."""

    map = Publisher(String, "map", latched=True, depth=1)

    @subscribe("told")
    def on_told(self, what: String) -> None:
        self.map.publish(what)


def test_what_is_latched_is_there_when_the_node_is_active(run_node: RunNode) -> None:
    mapper = run_node(Mapper)
    camera = run_node(Camera, autostart=False)
    mapper.send("told", String("old"))
    mapper.send("told", String("hall"))
    camera.change_state("configure")
    assert camera.published("seen") == []
    camera.change_state("activate")
    assert [one.data for one in camera.published("seen")] == ["hall"]
    camera.change_state("deactivate")
    camera.change_state("activate")
    assert len(camera.published("seen")) == 1, "it knows that already"
    camera.change_state("deactivate")
    mapper.send("told", String("yard"))
    camera.change_state("activate")
    assert [one.data for one in camera.published("seen")] == ["hall", "yard"]
    for step in ("deactivate", "cleanup", "configure", "activate"):
        camera.change_state(step)
    assert [one.data for one in camera.published("seen")] == ["hall", "yard", "yard"], "it has forgotten"


def test_a_node_that_is_taken_back_while_it_catches_up_hears_nothing_more(
    session: zenoh.Session, other: zenoh.Session
) -> None:
    class Slow(LifecycleNode):
        def on_start(self) -> None:
            self.log: list[str] = []
            self.begun = threading.Event()

        @subscribe("map", latched=True, depth=2)
        async def on_map(self, text: String) -> None:
            self.log.append(f"begin {text.data}")
            self.begun.set()
            await asyncio.sleep(0.1)
            self.log.append(f"end {text.data}")

    class Source(Node):
        map = Publisher(String, "map", latched=True, depth=2)

    node = Slow(namespace="r1", session=session)
    with Source(namespace="r1", session=other) as mapper:
        for text in ("1", "2"):
            mapper.map.publish(String(text))
        node.start(autostart=False)
        try:
            node.change_state("configure")
            eventually(lambda: node.status.received == {"r1/map": 2}, "both have come")
            active = threading.Thread(target=node.change_state, args=("activate",))
            active.start()
            assert node.begun.wait(PATIENCE)
            assert node.change_state("deactivate")
            active.join(PATIENCE)
            assert (node.lifecycle_state.label, node.log) == ("inactive", ["begin 1", "end 1"])
            assert [one for one in tokens(other, PATIENCE) if isinstance(one, NodeToken) and one.node == "slow"] == []
            assert node.change_state("activate")
            assert node.log == ["begin 1", "end 1", "begin 2", "end 2"]
        finally:
            node.close()


def test_who_asks_for_a_transition_waits_until_the_node_has_come_up(
    session: zenoh.Session, other: zenoh.Session
) -> None:
    asked_for: list[object] = []

    class Camera(LifecycleNode):
        def on_configure(self) -> None:
            asking.start()
            time.sleep(0.1)  # for it to arrive

    def ask() -> None:
        asked_for.append(asked(other, "r1/camera/change_state", transition={"label": "activate"}))

    asking = threading.Thread(target=ask)
    with Camera(namespace="r1", session=session) as camera:
        asking.join(PATIENCE)
        assert camera.lifecycle_state is LifecycleState.ACTIVE
        assert asked_for == [{"success": False}]


def test_a_latched_topic_of_a_managed_node_has_a_bound(robo_session: zenoh.Session) -> None:
    class Reader(LifecycleNode):
        @subscribe("map", latched=True, depth=KEEP_ALL)
        def on_map(self, _map: String) -> None:
            raise NotImplementedError

    with pytest.raises(ContractError, match="would keep it all for ever: say how many"):
        Reader(session=robo_session).start()


def test_what_a_latched_callback_raises_is_told(run_node: RunNode) -> None:
    class Reader(LifecycleNode):
        @subscribe("map", latched=True, depth=1)
        def on_map(self, _map: String) -> None:
            raise ValueError("no map")

    reader = run_node(Reader, autostart=False)
    reader.send("map", String("hall"))
    reader.change_state("configure")
    with pytest.raises(ValueError, match="no map"):
        reader.change_state("activate")
    assert reader.node.lifecycle_state is LifecycleState.ACTIVE


UP_TO = {"on_configure": [], "on_activate": ["configure"], "on_cleanup": ["configure"], "on_shutdown": ["configure"]}
UP_TO["on_deactivate"] = ["configure", "activate"]


@pytest.mark.parametrize("tidied", [True, False])
@pytest.mark.parametrize("hook", UP_TO)
def test_a_hook_that_raises_leads_to_on_error(run_node: RunNode, hook: str, tidied: bool) -> None:
    camera = run_node(Camera, autostart=False)
    for step in UP_TO[hook]:
        assert camera.change_state(step)
    camera.node.acts = {hook: breaks, "on_error": succeeds if tidied else fails}
    before = camera.node.lifecycle_state
    with pytest.raises(OSError, match="no device"):
        camera.change_state(hook.removeprefix("on_"))
    assert f"on_error from {before}" in camera.node.called
    if tidied:
        assert camera.node.lifecycle_state == LifecycleState.UNCONFIGURED
        assert not camera.has_ended()
        camera.node.acts.clear()
        assert camera.change_state("configure"), "it can begin anew"
    else:
        assert camera.node.lifecycle_state == LifecycleState.FINALIZED
        assert camera.has_ended()
        assert camera.exit_code == 1


def test_who_has_not_said_how_to_tidy_up_is_finalized(run_node: RunNode) -> None:
    camera = run_node(Camera, autostart=False)
    camera.node.acts = {"on_configure": lambda: ERROR}
    assert not camera.change_state("configure")
    assert camera.node.called[:2] == ["on_configure", "on_error from unconfigured"]
    assert camera.node.lifecycle_state == LifecycleState.FINALIZED
    assert camera.exit_code == 1


@pytest.mark.parametrize(("hook", "state"), [("on_configure", "unconfigured"), ("on_activate", "inactive")])
def test_a_failure_leaves_all_as_it_was(run_node: RunNode, hook: str, state: str) -> None:
    camera = run_node(Camera, autostart=False)
    for step in UP_TO[hook]:
        camera.change_state(step)
    camera.node.acts = {hook: fails}
    assert not camera.change_state(hook.removeprefix("on_"))
    assert camera.node.lifecycle_state.label == state
    camera.node.acts = {}
    assert camera.change_state(hook.removeprefix("on_"))


def test_a_deactivation_that_fails_leaves_the_node_at_work(run_node: RunNode, clock: Clock) -> None:
    camera = run_node(Camera)
    camera.node.acts = {"on_deactivate": fails}
    assert not camera.change_state("deactivate")
    camera.clear()
    clock.advance(0.1)
    assert [one.data for one in camera.published("image")] == ["tick"]


def test_a_hook_that_returns_something_else_has_gone_wrong(run_node: RunNode) -> None:
    camera = run_node(Camera, autostart=False)
    camera.node.acts = {"on_configure": lambda: True, "on_error": succeeds}  # type: ignore[dict-item, return-value]
    with pytest.raises(ValueError, match="True is not a valid TransitionCallbackReturn"):
        camera.change_state("configure")
    assert camera.node.lifecycle_state == LifecycleState.UNCONFIGURED


def test_shutdown_from_active_calls_on_shutdown_alone_and_ends_the_node(run_node: RunNode) -> None:
    camera = run_node(Camera)
    assert camera.change_state("shutdown")
    assert camera.has_ended()
    assert camera.exit_code == 0
    assert camera.node.called[2:] == ["on_shutdown", "on_stop"]
    assert "on_shutdown" in [one.data for one in camera.published("image")], "its last word is sent"


def test_a_node_that_cannot_come_to_active_does_not_start(run_node: RunNode) -> None:
    class Broken(Camera):
        def on_activate(self) -> None:
            raise OSError("no device")

        def on_error(self) -> TransitionCallbackReturn:
            return SUCCESS

    class Unwilling(Camera):
        def on_configure(self) -> TransitionCallbackReturn:
            return FAILURE

    told = "/broken does not come to active: on_activate raised OSError: no device; it is unconfigured, and ends"
    with pytest.raises(LifecycleError, match=told) as caught:
        run_node(Broken)
    assert isinstance(caught.value.__cause__, OSError)
    with pytest.raises(LifecycleError, match="on_configure said FAILURE; it is unconfigured, and ends"):
        run_node(Unwilling)


def test_an_end_by_its_own_hook_is_an_end(run_node: RunNode) -> None:
    def leave() -> None:
        raise SystemExit(3)

    camera = run_node(Camera, autostart=False)
    camera.node.acts = {"on_configure": leave}
    assert not camera.change_state("configure")
    assert camera.has_ended()
    assert camera.exit_code == 3


def test_a_node_that_is_told_to_end_on_its_way_up_goes_down_again(run_node: RunNode) -> None:
    class Hasty(Camera):
        def on_configure(self) -> None:
            super().on_configure()
            self.shutdown(4)

    hasty = run_node(Hasty)
    assert hasty.has_ended()
    assert hasty.exit_code == 4
    assert hasty.node.called == ["on_configure", "on_cleanup", "on_shutdown", "on_stop"]


def test_the_way_down_goes_on_where_a_hook_goes_wrong(run_node: RunNode) -> None:
    camera = run_node(Camera)
    camera.node.acts = {"on_deactivate": breaks, "on_error": succeeds}
    with pytest.raises(OSError, match="no device"):
        camera.close()
    assert camera.node.called[2:] == ["on_deactivate", "on_error from active", "on_shutdown", "on_stop"]
    assert camera.exit_code == 0


def test_one_that_does_not_want_to_rest_is_shut_down_all_the_same(run_node: RunNode) -> None:
    camera = run_node(Camera)
    camera.node.acts = {"on_deactivate": fails}
    camera.close()
    assert camera.node.called[2:] == ["on_deactivate", "on_shutdown", "on_stop"]


def test_a_callback_may_ask_for_a_transition_of_its_own_node(run_node: RunNode, clock: Clock) -> None:
    class Shy(Camera):
        @timer(rate=1.0)
        def rest(self) -> None:
            assert self.change_state("deactivate") is SUCCESS

    shy = run_node(Shy)
    clock.advance(1.0)
    assert shy.node.lifecycle_state is LifecycleState.INACTIVE


def test_main_begins_when_the_node_is_active_for_the_first_time(run_node: RunNode, clock: Clock) -> None:
    class Driver(LifecycleNode):
        said = Publisher(String, "said")

        def main(self) -> None:
            while self.sleep(1.0):
                self.said.publish(String("read"))

    driver = run_node(Driver, autostart=False)
    clock.advance(2.0)
    driver.change_state("configure")
    driver.change_state("activate")
    clock.advance(2.0)
    assert len(driver.published("said")) == 2
    driver.change_state("deactivate")
    driver.change_state("activate")
    clock.advance(1.0)
    assert len(driver.published("said")) == 3, "it runs once"


def test_a_plain_node_has_no_transitions(run_node: RunNode) -> None:
    class Plain(Node):
        pass

    plain = run_node(Plain)
    with pytest.raises(NotThere, match="/plain is a plain node; a managed one derives from LifecycleNode"):
        plain.change_state("configure")


@pytest.mark.parametrize("name", ["on_configure", "on_activate", "on_deactivate", "on_cleanup"])
def test_a_hook_that_would_never_be_called_is_refused(name: str) -> None:
    plain = type("Plain", (Node,), {name: lambda self: None})  # noqa: ARG005
    with pytest.raises(ContractError, match=f"Plain.{name} is a hook of managed nodes .* derive from robo.Lifecycle"):
        plain()


def test_a_subscription_may_be_called_as_a_hook_is() -> None:
    class Plain(Node):
        @subscribe("activate")
        def on_activate(self, _: String) -> None: ...

        def on_error(self) -> None: ...

    Plain()


def test_a_hook_is_a_plain_function() -> None:
    class Waits(LifecycleNode):
        async def on_configure(self) -> None:  # type: ignore[override]
            ...

    with pytest.raises(ContractError, match="on_configure is async"):
        Waits()


# -- on the wire ---------------------------------------------------------------------------------


def asked(session: zenoh.Session, key: str, **fields: object) -> object:
    for reply in session.get(key, payload=msgpack.packb(fields), timeout=PATIENCE):
        assert reply.ok is not None, reply.err
        return msgpack.unpackb(reply.ok.payload.to_bytes())
    raise AssertionError(f"nobody answers on {key}")


def test_a_plain_zenoh_client_drives_a_node(session: zenoh.Session, other: zenoh.Session) -> None:
    events = hear(other, "r1/camera/transition_event")
    camera = Camera(namespace="r1", session=session)
    camera.start(autostart=False)
    try:
        key = "r1/camera"
        assert asked(other, f"{key}/get_state") == {"current_state": {"id": 1, "label": "unconfigured"}}
        assert asked(other, f"{key}/change_state", transition={"label": "configure"}) == {"success": True}
        assert asked(other, f"{key}/change_state", transition={"id": 3}) == {"success": True}
        assert asked(other, f"{key}/get_state") == {"current_state": {"id": 3, "label": "active"}}
        assert asked(other, f"{key}/change_state", transition={"label": "configure"}) == {"success": False}
        moves = [msgpack.unpackb(one.payload.to_bytes()) for one in samples(events, 4)]
        assert [(one["transition"]["id"], one["goal_state"]["label"]) for one in moves] == [
            (1, "configuring"),
            (10, "inactive"),
            (3, "activating"),
            (30, "active"),
        ]
        assert all(one["timestamp"] > 0 for one in moves)
        found = asked(other, f"{key}/get_available_transitions")
        assert isinstance(found, dict)
        ways = [(one["transition"]["id"], one["transition"]["label"]) for one in found["available_transitions"]]
        assert ways == [(4, "deactivate"), (7, "shutdown")]
        states = asked(other, f"{key}/get_available_states")
        assert isinstance(states, dict)
        assert [one["id"] for one in states["available_states"]] == [0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 15]
        graph = asked(other, f"{key}/get_transition_graph")
        assert isinstance(graph, dict)
        assert len(graph["available_transitions"]) == 25
    finally:
        camera.close()


def test_the_state_is_told_while_a_hook_runs_and_nothing_else_can_be_asked_for(
    session: zenoh.Session, other: zenoh.Session
) -> None:
    entered, may_go = threading.Event(), threading.Event()

    def wait() -> None:
        entered.set()
        assert may_go.wait(PATIENCE)

    camera = Camera(namespace="r1", session=session)
    camera.acts = {"on_configure": wait}
    camera.start(autostart=False)
    try:
        answers: list[object] = []
        request = {"transition": {"label": "configure"}}
        asking = threading.Thread(
            target=lambda: answers.append(asked(other, "r1/camera/change_state", **request)), daemon=True
        )
        asking.start()
        assert entered.wait(PATIENCE)
        assert asked(other, "r1/camera/get_state") == {"current_state": {"id": 10, "label": "configuring"}}
        assert camera.status.running == "on_configure"
        may_go.set()
        asking.join(PATIENCE)
        assert answers == [{"success": True}]
    finally:
        may_go.set()
        camera.close()


def test_the_token_shows_while_the_node_is_active_and_says_yes(session: zenoh.Session, other: zenoh.Session) -> None:
    class Warm(Camera):
        warm = False

        def ready(self) -> bool:
            return self.warm

    def shows() -> bool:
        return any(reply.ok is not None for reply in other.liveliness().get("@robo/r1/node/warm/**", timeout=PATIENCE))

    node = Warm(namespace="r1", session=session)
    node.start(autostart=False)
    try:
        node.warm = True
        node.change_state("configure")
        assert not shows()
        node.change_state("activate")
        eventually(shows, "its token")
        node.change_state("deactivate")
        eventually(lambda: not shows(), "no token")
        node.warm = False
        node.change_state("activate")
        assert not shows()
        node.warm = True
        eventually(shows, "its token again")
    finally:
        node.close()


def test_a_node_may_live_again(session: zenoh.Session) -> None:
    camera = Camera(namespace="r1", session=session)
    for _ in range(2):
        with camera:
            assert camera.status.lifecycle == "active"
        assert camera.status.lifecycle == "finalized"
    with pytest.raises(RuntimeError, match="has not started"):
        camera.change_state("configure")


def test_the_types_of_its_services_are_known_by_name() -> None:
    for one in (ChangeState, GetState, GetAvailableStates, GetAvailableTransitions):
        assert one.Request.__name__ == "Request"
    assert TransitionEvent().goal_state.id == 0
