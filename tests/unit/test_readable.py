"""Types that several threads come to know at once."""

import sys
import threading
from collections.abc import Callable
from typing import Annotated, Any

import msgspec
import pytest

from robo.text.readable import readable
from robo_messages import decoder_of

Asks = Callable[[Any], object]


@pytest.mark.parametrize(
    ("first", "second", "has_messages"),
    [
        (readable, readable, True),
        (readable, decoder_of, True),
        (decoder_of, readable, True),
        (readable, readable, False),
    ],
)
def test_who_comes_while_a_type_is_found_out_waits_for_the_whole(
    first: Asks, second: Asks, has_messages: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_messages:  # as in a router's process
        monkeypatch.delitem(sys.modules, "robo_messages._registry")
    begun, go_on, whole = threading.Event(), threading.Event(), threading.Event()

    def slow() -> type[int]:
        begun.set()
        assert go_on.wait(10.0)
        return int

    monkeypatch.setitem(globals(), "slow", slow)
    # What an annotation in quotes stands for is looked up when msgspec is to know the type: with half of `outer` found.
    inner = msgspec.defstruct("Inner", [("x", "slow()")], module=__name__)
    outer = msgspec.defstruct("Outer", [("inner", inner), ("y", int)], module=__name__)

    def find_out() -> None:
        first(outer)
        whole.set()

    finder = threading.Thread(target=find_out)
    finder.start()
    assert begun.wait(10.0)
    other = threading.Thread(target=second, args=(outer,))
    other.start()
    other.join(0.2)
    waited = other.is_alive()
    go_on.set()
    finder.join(10.0)
    other.join(10.0)
    assert waited
    assert whole.is_set()
    assert msgspec.convert({"inner": {"x": 1}, "y": 2}, outer) == outer(inner(1), 2)


def test_a_type_whose_annotations_have_no_hash_is_readable_too() -> None:
    hint = Annotated[list[int], {"unit": "m"}]
    assert msgspec.convert([1], readable(hint)) == [1]


def test_what_msgspec_cannot_read_is_told() -> None:
    with pytest.raises(TypeError, match="more than one"):
        readable(list[int] | set[int])
