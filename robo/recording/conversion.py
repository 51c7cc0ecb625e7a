"""Messages as they come from the network, and as a recording holds them."""

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import zenoh

from robo.bag.options import TopicInFile
from robo.bag.write.writer import MOST_MESSAGE
from robo.recording.forms import Form, form_of
from robo.recording.senders import Senders
from robo.text.brief import brief
from robo.text.once import Once
from robo.wire.codec import Malformed, unpack_attachment
from robo.wire.keys import source_id
from robo.wire.qos import QoS

_MOST_FORMS = 10_000
"""That are remembered: topics and encodings that a stranger makes up fill no memory."""

_OTHERS = "(others)"
"""Where malformed messages are counted beyond that."""

_MOST_NUMBER = 2**53
"""No publisher has sent so many messages: what says so is a stranger's attachment that means something else."""


class Came(NamedTuple):
    """A message as it came."""

    key: str
    """Its topic."""
    arrived: int
    """By this machine's clock, ns since the epoch."""
    sample: zenoh.Sample
    is_kept: bool = False
    """Whether it was said before, and its latched publisher has been asked for it."""


class Refused(NamedTuple):
    """A message that is not written down."""

    key: str
    """Its topic."""
    sequence: int | None
    published: int
    source: str | None
    """These as of `Converted`."""


class Offer(NamedTuple):
    """What the publishers of a topic say of it."""

    qos: QoS = QoS.DEFAULT
    type: str = ""
    """Empty where nobody says it, or not all the same."""
    publishers: tuple[str, ...] = ()
    """Zenoh's ids of them, as `keys.source_id` makes them."""


class Converted(NamedTuple):
    """A message as a recording holds it: what `robo.bag.Recording.write` wants."""

    topic: TopicInFile
    data: bytes
    arrived: int
    """ns since the epoch, by this machine's clock."""
    published: int
    """ns since the epoch, by the publisher's; when it came, where that is not said."""
    sequence: int | None
    """None where its publisher does not count."""
    source: str | None
    """Which publisher has sent it: Zenoh's id of that, or another word where it is not said; None where it does not
    count."""


def nothing_known(_: str) -> Offer:
    """Of no topic anything is known."""
    return Offer()


class Conversion:
    """Turns messages into what a recording holds. Used by one thread at a time."""

    def __init__(
        self,
        tell: Callable[[str], object],
        offer_of: Callable[[str], Offer] = nothing_known,
        refused: Callable[[Refused], object] = lambda _: None,
    ) -> None:
        """
        Args:
            tell: is told once, for each topic, what is not written down, or only as its bytes, and why.
            offer_of: what is known of a topic's publishers.
            refused: is told of each message that is not written down.
        """
        self.malformed: Counter[str] = Counter()
        """Messages that could not be written down, by topic."""
        self._tell_once = Once(tell, _MOST_FORMS)
        self._offer_of = offer_of
        self._refused = refused
        self._forms: dict[tuple[str, str], Form] = {}
        self._senders = Senders(lambda key: offer_of(key).publishers)

    def convert(self, came: Came) -> Converted | None:
        """A message as a recording holds it; None where it is malformed, which is counted, or was there before."""
        key, arrived, sample, is_kept = came
        encoding = str(sample.encoding)
        form = self._forms.get((key, encoding))
        if form is None:
            form = self._new_form(key, encoding)
        attachment = sample.attachment
        stamp = unpack_attachment(attachment.to_bytes()) if attachment is not None else None
        published: int = arrived
        sequence: int | None = None
        sender: str | None = None
        if stamp is not None and 0 < stamp.sequence_number < _MOST_NUMBER:
            sequence, published = stamp
            source = sample.source_info
            signed = source_id(source.source_id) if source is not None else None
            if is_kept and self._senders.has(key, signed, sequence):
                return None  # it came before its publisher was known to be latched
            sender = self._senders.sender(key, signed, sequence)
        payload = sample.payload.to_bytes()
        try:
            data = form.write(payload)
            if len(data) > MOST_MESSAGE:
                raise Malformed(f"it has {len(data):,} bytes, and at most {MOST_MESSAGE:,} go into a file")
        except Malformed as reason:
            self.refuse(Refused(key, sequence, published, sender), str(reason))
            return None
        return Converted(form.topic, data, arrived, published, sequence, sender)

    def forget(self, key: str) -> None:
        """What is known of a topic's publishers has changed: it is asked again."""
        for known in [one for one in self._forms if one[0] == key]:
            del self._forms[known]

    def refuse(self, message: Refused, reason: str) -> None:
        """A message is not written down: it is counted, and the reason told where it is the first of its topic."""
        key = message.key
        if key not in self.malformed and len(self.malformed) >= _MOST_FORMS:
            message = Refused(_OTHERS, None, message.published, None)
        self.malformed[message.key] += 1
        self._refused(message)
        told = brief(f"{key}: a message cannot be written down, and is counted: {reason}")
        self._tell_once(told, f"{key} malformed")

    def _new_form(self, key: str, encoding: str) -> Form:
        offer = self._offer_of(key)
        form = form_of(key, encoding, offer.qos, offer.type)
        if len(self._forms) >= _MOST_FORMS:
            del self._forms[next(iter(self._forms))]
        self._forms[key, encoding] = form
        if form.unknown:
            told = brief(f"{key} is recorded as the bytes that came: {form.unknown}")
            self._tell_once(told, f"{key} is recorded as bytes")
        return form
