"""CDR of types that nobody thought of: random messages in random messages, whole, damaged and hostile."""

import random
import struct
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import suppress
from typing import Annotated, Any

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from msgspec import Meta, field

import robo_messages
from robo.errors import MessageError
from robo.interfaces.cdr import decoder, encoder
from robo.interfaces.cdr_faults import decode_fault
from robo.interfaces.ros_shape import shape_of
from robo_messages import Message, Point, message
from robo_messages.fields import Char, Chars, Int8, WString
from tests.imported import imported, made_of, types_of
from tests.random_messages import messages, rounded
from tests.random_types import definitions
from tests.unit.test_cdr_damaged import mutated

HEAD = b"\x00\x01\x00\x00"
SEEDS = range(12)


@pytest.fixture(params=SEEDS)
def types(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[type[Message]]]:
    """Eight types that stand in each other."""
    folder = tmp_path_factory.mktemp("types")
    with imported(folder / "out", made_of(folder / "src", definitions(request.param, 8))) as modules:
        yield list(types_of(modules).values())


def test_what_is_read_is_what_was_written(types: list[type[Message]]) -> None:
    @settings(max_examples=20, deadline=None, database=None, phases=(Phase.generate, Phase.shrink))
    @given(st.data())
    def check(data: st.DataObject) -> None:
        for type_ in types:
            one = data.draw(messages(type_))
            written = encoder(type_)(one)
            back = decoder(type_)(written)
            assert robo_messages.encode(back) == robo_messages.encode(rounded(one))
            assert encoder(type_)(back) == written
            assert robo_messages.encode(
                decoder(type_)(memoryview(b"123" + written + b"4")[3:])
            ) == robo_messages.encode(back)

    check()


def test_damaged_bytes_are_a_message_or_an_error(types: list[type[Message]]) -> None:
    rng = random.Random(types[0].__module__)
    for type_ in types:
        well = [encoder(type_)(type_()), HEAD + rng.randbytes(200), b"\0\0\0\0" + rng.randbytes(200)]
        for number in range(150):
            data = mutated(well[number % len(well)], rng)
            try:
                decoder(type_)(data)
            except MessageError as error:
                said = str(error)
            else:
                said = f"{robo_messages.type_name(type_)}: well"
                assert str(decode_fault(shape_of(type_), data, ValueError("well"))) == said
            assert said.startswith(robo_messages.type_name(type_))
            assert "it is no message of this type" not in said, data.hex()


def test_hostile_lengths_take_neither_memory_nor_time(types: list[type[Message]]) -> None:
    rng = random.Random(types[0].__module__)
    fills = (b"\xff" * 4, b"\xff\xff\xff\x7f", b"\x00\x40\x00\x00", b"\x01\x00\x00\x00", b"\x00\x00\x00\x01", b"\0" * 4)
    for type_ in types:
        for fill in fills:
            for head in (HEAD, b"\0\0\0\0"):
                data = head + rng.choice((fill * 4096, rng.randbytes(16_384)))
                with suppress(MessageError):
                    decoder(type_)(data)  # makes the functions
                tracemalloc.start()
                begin = time.process_time()
                with suppress(MessageError):
                    decoder(type_)(data)
                took, peak = time.process_time() - begin, tracemalloc.get_traced_memory()[1]
                tracemalloc.stop()
                assert peak < 100 * len(data)
                assert took < 5


@message("test_nested/Wide")
class Wide(Message):
    before: bool = False
    text: WString = ""
    few: Annotated[list[WString], Meta(max_length=2)] = field(default_factory=list)
    short: Annotated[str, Meta(max_length=3, extra={"ros": "wstring"})] = ""
    after: float = 0.0


def test_a_wide_text_is_units_of_four_bytes() -> None:
    data = encoder(Wide)(Wide(True, "aä😀", ["", "b"], "xyz", 1.0))
    expected = struct.pack(
        "<?3x I4I I I I1I I3I d", True, 4, 0x61, 0xE4, 0xD83D, 0xDE00, 2, 0, 1, 0x62, 3, *b"xyz", 1.0
    )
    assert data == HEAD + expected
    assert decoder(Wide)(data) == Wide(True, "aä😀", ["", "b"], "xyz", 1.0)
    other = b"\0\0\0\0" + struct.pack(">?3x I2I I I d", True, 2, 0x61, 0xE4, 0, 0, 1.0)
    assert decoder(Wide)(other) == Wide(True, "aä", [], "", 1.0)
    assert decoder(Wide)(encoder(Wide)(Wide(text="a\0b"))).text == "a\0b"


@pytest.mark.parametrize(
    ("wide", "said"),
    [
        (Wide(text="\ud800"), "test_nested/Wide.text: '.*' is no Unicode text: surrogates not allowed"),
        (Wide(text=5), "test_nested/Wide.text: expected a text, got int 5"),  # type: ignore[arg-type]
        (Wide(few=["a", "\ud800"]), r"test_nested/Wide.few\[1\]: '.*' is no Unicode text: .*"),
        (Wide(short="abcd"), "test_nested/Wide.short: Expected `str` of length <= 3"),
    ],
)
def test_a_wide_text_that_does_not_fit_is_named(wide: Wide, said: str) -> None:
    with pytest.raises(MessageError, match=f"^{said}$"):
        encoder(Wide)(wide)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (struct.pack("<?3xI", False, 2**32 - 1), "text: cut short: 17179869180 bytes are wanted, and 0 are left"),
        (struct.pack("<?3xII", False, 1, 0x10000), "text: no UTF-16: a unit of 65536"),
        (struct.pack("<?3xII", False, 1, 0xD800), "text: no UTF-16: unexpected end of data"),
        (struct.pack("<?3xIIIIIII", False, 0, 0, 4, 1, 1, 1, 1) + bytes(12), "short: Expected `str` of length <= 3"),
    ],
)
def test_bytes_that_are_no_wide_text_are_refused(data: bytes, said: str) -> None:
    with pytest.raises(MessageError) as caught:
        decoder(Wide)(HEAD + data)
    assert str(caught.value) == f"test_nested/Wide.{said}"


@message("test_nested/Single")
class Single(Message):
    one: Annotated[tuple[float, ...], Meta(min_length=1, max_length=1)] = (0.0,)
    listed: Annotated[list[int], Meta(min_length=1, max_length=1)] = field(default_factory=lambda: [0])
    flags: tuple[bool] = (False,)
    point: Annotated[tuple[Point, ...], Meta(min_length=1, max_length=1)] = field(default_factory=lambda: (Point(),))
    letters: Chars = memoryview(b"")
    letter: Char = 0
    small: Annotated[tuple[Int8, ...], Meta(min_length=1, max_length=1)] = (0,)


def test_an_array_of_one_is_an_array() -> None:
    value = Single((1.5,), [7], (True,), (Point(1.0),), memoryview(b"ab"), 65, (-1,))
    back: Any = decoder(Single)(encoder(Single)(value))
    assert back == value
    assert (type(back.one), type(back.listed), type(back.flags)) == (tuple, list, tuple)
