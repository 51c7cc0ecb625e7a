"""What a node class says of its checks, and what a check may return."""

import math
from typing import Any

import pytest

from robo import ContractError, Health, Node, Part, check
from robo.node.contract import contract_of
from robo.node.contract_data import CheckData
from robo.node.contract_text import contract_data, contract_text
from robo_messages import DiagnosticStatus, KeyValue


class Lamp(Part):
    """Burns."""

    @check("lamp")
    def burns(self) -> Health:
        return Health.ok()


class Torch(Node):
    """A lamp and a battery."""

    lamp = Lamp()

    @check("battery")
    def battery(self) -> Health:
        return Health.warn("low", volts=10.5)


class Mute(Torch):
    def battery(self) -> Health:
        return Health.ok()


def test_checks_are_in_the_contract_those_of_parts_too() -> None:
    data = contract_data(Torch)
    assert data.checks == (CheckData("lamp", "lamp.burns"), CheckData("battery", "battery"))
    text = contract_text(data)
    assert "checks:\n  lamp               lamp.burns\n  battery            battery\n" in text
    assert contract_of(Mute).checks == contract_of(Mute).checks[:1], "what it overrides is no check any more"
    assert contract_of(Node).checks == ()


@pytest.mark.parametrize("name", ["", " ", "a/b", "a: b", "a:", " battery", "battery ", "a\nb", "\x1b[2J"])
def test_names_that_nobody_could_read_are_refused(name: str) -> None:
    with pytest.raises(ContractError, match="name what is checked in a word or two"):
        check(name)


def test_a_check_without_its_name_is_refused_by_a_sentence() -> None:
    with pytest.raises(ContractError, match=r'@check needs the name of what is checked: @check\("speed"\)'):

        @check  # type: ignore[arg-type]
        def speed(self: Node) -> Health:
            raise NotImplementedError


def test_names_that_nobody_could_tell_apart_are_refused() -> None:
    class Twice(Torch):
        @check("battery")
        def other(self) -> Health:
            return Health.ok()

    class Taken(Node):
        @check("topics")
        def topics(self) -> Health:
            return Health.ok()

    with pytest.raises(ContractError, match=r"Twice\.other: there is a check 'battery' already, battery; name it"):
        contract_of(Twice)
    with pytest.raises(ContractError, match=r"Taken\.topics: there is a check 'topics' already, one that every node"):
        contract_of(Taken)


def test_methods_that_are_no_checks_are_refused() -> None:
    class Async(Node):
        async def battery(self) -> Health:
            return Health.ok()

    class Yields(Node):
        def battery(self) -> Any:
            yield Health.ok()

    class Takes(Node):
        def battery(self, volts: float) -> Health:
            return Health.ok(volts=volts)

    mark: Any = check("battery")
    refused: list[tuple[type[Node], str]] = [
        (Async, "battery is async"), (Yields, "yields"), (Takes, "a check's method takes self"),
    ]  # fmt: skip
    for cls, why in refused:
        mark(vars(cls)["battery"])
        with pytest.raises(ContractError, match=why):
            contract_of(cls)


def test_a_health_becomes_a_status() -> None:
    assert Health.ok().status() == DiagnosticStatus()
    found = Health.warn("low", volts=10.123456789, cells=6, odd=math.nan, ok=True).status()
    assert (found.level, found.message) == (DiagnosticStatus.WARN, "low")
    assert found.values == [
        KeyValue("volts", "10.1235"), KeyValue("cells", "6"), KeyValue("odd", "nan"), KeyValue("ok", "True"),
    ]  # fmt: skip
    assert Health.error("broken").level == DiagnosticStatus.ERROR
    assert Health(DiagnosticStatus.WARN, "x", {"a b": 1}).status().values == [KeyValue("a b", "1")]
    for level in (3, -1, 17, "ok", None, True, 1.0):
        odd: Any = level
        with pytest.raises(ValueError, match="is no level"):
            Health(odd).status()
