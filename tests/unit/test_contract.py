from collections.abc import AsyncIterator, Callable, Iterator
from functools import partial, wraps
from typing import Annotated, Any
from unittest.mock import MagicMock

import pytest
from msgspec import Meta

import robo
from robo import KEEP_ALL, MessageInfo, Node, Publisher, subscribe, timer
from robo.errors import ContractError, ParameterError
from robo.node.callables import is_async, takes_info
from robo.node.contract import check_constructor, contract_of, snake_case
from robo.node.loading import load_node_class
from robo_messages import Message, Odometry, Point, Twist
from robo_services.position_tracker import PositionTracker


def test_the_contract_of_a_shipped_node_is_read_without_running_it() -> None:
    contract = contract_of(PositionTracker)
    assert contract.name == "position_tracker"
    assert contract.description == "Track where the robot is and how far it has driven."
    assert [(s.topic, s.message_type, s.qos.depth, s.method) for s in contract.subscriptions] == [
        ("odom", Odometry, KEEP_ALL, "on_odometry")
    ]
    assert [(p.topic, p.message_type) for p in contract.publishers] == [("current_position", Point)]
    assert [(t.rate, t.method) for t in contract.timers] == [("log_rate", "report")]
    assert [(p.name, p.default) for p in contract.parameters] == [
        ("max_distance", 100.0), ("max_linear_velocity", 10.0), ("max_angular_velocity", 20.0), ("log_rate", 1.0),
        ("use_sim_time", False),
    ]  # fmt: skip


def test_a_subclass_inherits_and_overrides() -> None:
    class Faster(PositionTracker):
        class Parameters(PositionTracker.Parameters):
            log_rate: Annotated[float, Meta(gt=0)] = 10.0

        @timer(rate="log_rate")
        def report(self) -> None:
            """Say nothing."""

    contract = contract_of(Faster)
    assert contract.name == "faster"
    assert len(contract.timers) == 1
    assert {p.name: p.default for p in contract.parameters} == {
        "max_distance": 100.0, "max_linear_velocity": 10.0, "max_angular_velocity": 20.0, "log_rate": 10.0,
        "use_sim_time": False,
    }  # fmt: skip


def test_a_callback_without_a_message_type_is_refused() -> None:
    class Silent(Node):
        def on_odometry(self, odometry) -> None:  # type: ignore[no-untyped-def]
            """Take anything."""

    subscribe("odom")(Silent.on_odometry)
    with pytest.raises(ContractError, match=r"Silent\.on_odometry: annotate 'odometry'"):
        contract_of(Silent)


def test_a_type_without_a_name_is_refused() -> None:
    class Foreign(Message):
        pass

    class Sender(Node):
        out = Publisher(Foreign, "out")

    with pytest.raises(ContractError, match=r"Sender\.out: .*Foreign has no message name"):
        contract_of(Sender)


def test_a_timer_that_names_no_parameter_is_refused() -> None:
    class Ticker(Node):
        @timer(rate="speed")
        def tick(self) -> None:
            """Tick."""

    with pytest.raises(ContractError, match="names no parameter"):
        contract_of(Ticker)
    with pytest.raises(ContractError, match=r"rate of 0\.0 Hz: use 1e-09 to 1e"):
        timer(rate=0.0)


class Caller:
    async def __call__(self) -> None:
        """Do nothing that anybody waits for."""


async def _later(*_: object) -> None:
    """Do nothing that anybody waits for."""


def _yielding() -> Iterator[None]:
    yield


async def _yielding_later() -> AsyncIterator[None]:
    yield


@pytest.mark.parametrize("callback", [_later, partial(_later, 1), Caller(), Caller().__call__])
def test_what_the_loop_has_to_run_is_known_by_its_definition(callback: Callable[[], object]) -> None:
    assert is_async(callback)


@pytest.mark.parametrize("callback", [print, partial(print, 1), [].append, Caller, str, MagicMock(), lambda: None])
def test_other_callbacks_are_plain(callback: Callable[[], object]) -> None:
    assert not is_async(callback)


@pytest.mark.parametrize("callback", [_yielding, partial(_yielding), _yielding_later])
def test_callbacks_whose_call_does_nothing_are_refused(callback: Callable[[], object]) -> None:
    with pytest.raises(ContractError, match=r"test_contract\.py:\d+: .* yields, so that calling it does nothing"):
        is_async(callback)


def decorated(method: Callable[..., None]) -> Callable[..., None]:
    @wraps(method)
    def hand_on(*arguments: Any) -> None:
        method(*arguments)

    return hand_on


class Receiver:
    def plain(self, message: Twist) -> None:
        """Take a message."""

    def informed(self, message: Twist, info: MessageInfo) -> None:
        """Take what is known of it, too."""

    decorated_plain = decorated(plain)
    decorated_informed = decorated(informed)


def test_what_takes_what_is_known_of_a_message_does_so_behind_a_decorator_too() -> None:
    one = Receiver()
    informed: list[Callable[..., object]] = [one.informed, one.decorated_informed, lambda _twist, _info: None]
    informed += [partial(lambda _name, _twist, _info: None, "front"), partial(partial(one.informed))]
    assert all(takes_info(callback) for callback in informed)
    others: list[Callable[..., object]] = [one.plain, one.decorated_plain, lambda _twist, _more=1: None, print]
    others += [partial(one.informed, info=MessageInfo(0.0)), partial(lambda _name, _twist: None, "front")]
    assert not any(takes_info(callback) for callback in others)


def test_a_hook_that_is_async_is_refused() -> None:
    class Waiting(Node):
        async def on_start(self) -> None:  # type: ignore[override]
            """Do nothing that anybody waits for."""

    with pytest.raises(ContractError, match=r"test_contract\.py:\d+: Waiting\.on_start is async; that may be"):
        contract_of(Waiting)


def test_parameters_that_are_no_robo_parameters_are_refused() -> None:
    class Plain(Node):
        class Parameters:
            rate = 1.0

    with pytest.raises(ContractError, match=r"write class Parameters\(robo\.Parameters\)"):
        Plain()


def test_a_constructor_that_takes_no_options_is_refused_for_processes() -> None:
    class Bare(Node):
        def __init__(self) -> None:
            super().__init__(name="bare")

    class Open(Bare):
        def __init__(self, **_: object) -> None:
            super().__init__()

    with pytest.raises(ContractError, match=r"test_contract\.py:\d+: Bare\.__init__ does not take .*on_start"):
        check_constructor(Bare)
    check_constructor(Open)
    check_constructor(PositionTracker)
    assert Bare().name == "bare"  # by hand it may be made


def test_endpoints_made_too_early_are_refused() -> None:
    class Early(Node):
        def __init__(self, **options: Any) -> None:
            super().__init__(**options)
            self.create_publisher(Twist, "x")

    class Ticking(Node):
        def __init__(self, **options: Any) -> None:
            super().__init__(**options)
            self.create_timer(1.0, lambda: None)  # would never tick: a start makes all anew

    for cls, made in ((Early, "create_publisher before /early"), (Ticking, "create_timer before /ticking")):
        with pytest.raises(ContractError, match=rf"test_contract\.py:\d+: {made} has started"):
            cls()


def test_depths_and_misuse() -> None:
    with pytest.raises(ContractError, match="depth -1"):
        subscribe("odom", depth=-1)
    node = PositionTracker(namespace="r1")
    with pytest.raises(ContractError, match="before the node has started"):
        node.position.publish(Point())
    with pytest.raises(RuntimeError, match="has not started"):
        assert node.session


def test_a_node_checks_its_values_when_it_is_made() -> None:
    with pytest.raises(ParameterError, match="/r1/position_tracker: log_rate = -1"):
        PositionTracker(namespace="r1", parameters={"log_rate": -1})
    assert PositionTracker(namespace="r1", parameters={"log_rate": 2}).parameters.log_rate == 2.0


@pytest.mark.parametrize(
    ("name", "expected"), [("PositionTracker", "position_tracker"), ("IMUDriver", "imu_driver"), ("A2B", "a2_b")]
)
def test_default_names(name: str, expected: str) -> None:
    assert snake_case(name) == expected


def test_services_are_found_by_name() -> None:
    assert load_node_class("robo_services.position_tracker") is PositionTracker
    assert load_node_class("robo_services.position_tracker:PositionTracker") is PositionTracker


@pytest.mark.parametrize(
    ("service", "message"),
    [
        ("robo_services.position_traker", "did you mean robo_services.position_tracker"),
        ("nowhere", "there is no service 'nowhere'"),
        ("robo_services.position_tracker:Tracker", "it has PositionTracker"),
        ("robo_services.planar", "defines no node class"),
        ("./nodes/grip.py", "is a file; write its module, nodes.grip"),
        ("robo_services", "defines no node class; it has robo_services.arduino_base, "),
        ("position_tracker", "did you mean robo_services.position_tracker?"),
    ],
)
def test_services_that_are_not_there(service: str, message: str) -> None:
    with pytest.raises(ContractError, match=message):
        load_node_class(service)


def test_what_robo_exports() -> None:
    for name in robo.__all__:
        assert getattr(robo, name).__doc__ or name == "KEEP_ALL"
