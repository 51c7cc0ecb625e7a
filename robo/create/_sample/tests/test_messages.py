"""Each message of this package reads as it was written."""

from robo_messages import Message, decode, encode

from sample_robot import messages


def own_types() -> list[type[Message]]:
    """The message types that messages.py defines."""
    classes = [value for value in vars(messages).values() if isinstance(value, type)]
    return [one for one in classes if issubclass(one, Message) and one.__module__ == messages.__name__]


def test_messages_read_as_they_were_written() -> None:
    for type_ in own_types():
        assert decode(encode(type_()), type_) == type_()
