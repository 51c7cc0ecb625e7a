"""`robo topic hz`, `bw`, `delay` and `loss`: printing figures about topics, window by window."""

import time
from collections.abc import Collection, Sequence

import zenoh

from robo.cli.connection import connect_to_robot
from robo.cli.link import watched
from robo.cli.printing import data_size, note, print_json, print_line
from robo.cli.reach import Reach
from robo.cli.views.waiting import complain_of_few, tell_who_is_waited_for
from robo.samples.meters import Bandwidth, Delay, Loss, Measure, Meter, Rate, Window
from robo.samples.stream import Stream
from robo.text.terminal import visible
from robo.tools import net
from robo.tools.topics import Topic

SILENT = 3.0
"""After how long without a message it is said that a topic is silent, s."""


def print_figures(
    measure: Measure,
    names: Sequence[str],
    reach: Reach,
    *,
    count: int | None,
    duration: float | None,
    window: float,
    json: bool,
) -> int:
    """Print figures until there were enough windows, the time is over, or Ctrl-C.

    Returns:
        1 where the time was over before as many windows were printed as were asked for, or any.
    """
    keys = [reach.key(name) for name in names]
    with connect_to_robot(reach) as session, watched(session, reach):
        stream = Stream(session, keys)
        found = tell_who_is_waited_for(session, keys, reach, endless=duration is None)
        publishers = {topic.key: len(topic.publishers) for topic in found}
        differing = _clocks_that_differ(session, keys, found, reach) if measure == "delay" else set()
        measuring = _Measuring(measure, publishers, differing, json=json)
        end = time.monotonic() + duration if duration is not None else None
        due = time.monotonic() + window
        shown = 0
        while count is None or shown < count:
            arrival = stream.get(due if end is None else min(due, end))
            if arrival is not None:
                attachment = arrival.attachment
                number, published = attachment if attachment is not None else (None, arrival.arrived)
                measuring.meter(arrival.key).add(number, published, arrival.arrived, arrival.size)
            now = time.monotonic()
            over = end is not None and now >= end
            if now >= due or over:
                shown += measuring.print_window(now)
                due = now + window
            if over and not stream.waiting:
                break
        stream.close()
    return complain_of_few(keys, shown, count, duration, what="message" if count is None else "window with messages")


def _clocks_that_differ(session: zenoh.Session, keys: Sequence[str], there: Sequence[Topic], reach: Reach) -> set[str]:
    """Of the topics that are meant, those with a publisher whose clock is not this machine's; says which."""
    wanted = [zenoh.KeyExpr(key) for key in keys]
    meant = [topic for topic in there if any(key.intersects(zenoh.KeyExpr(topic.key)) for key in wanted)]
    off = net.clocks_off(session, {node for topic in meant for node in topic.publishers}, reach.timeout)
    for text in off.values():
        note(visible(text))
    return {topic.key for topic in meant if not off.keys().isdisjoint(topic.publishers)}


class _Measuring:
    def __init__(self, measure: Measure, publishers: dict[str, int], differing: Collection[str], *, json: bool) -> None:
        self._measure = measure
        self._publishers = publishers
        self._differing = differing
        self._json = json
        self._meters: dict[str, Meter] = {}
        self._heard: dict[str, float] = {}

    def meter(self, key: str) -> Meter:
        """The meter of a topic."""
        found = self._meters.get(key)
        if found is None:
            found = self._meters[key] = Meter(key, self._publishers.get(key, 1))
        return found

    def print_window(self, now: float) -> bool:
        """Print what each topic has; returns whether there was anything."""
        found = False
        for key in sorted(self._meters):
            figures = self._meters[key].window(self._measure)
            if figures is not None:
                found = True
                self._heard[key] = now
                if self._json:
                    print_json(figures)
                else:
                    _print_figures(figures, differs=key in self._differing)
            elif now - self._heard.setdefault(key, now) >= SILENT:
                self._heard[key] = now
                note(f"{visible(key)}: no messages for {SILENT:g} s")
        return found


def _print_figures(figures: Window, *, differs: bool) -> None:
    told = "  (clocks differ)" if isinstance(figures, Delay) and (differs or figures.min < 0) else ""
    print_line(f"{figures.key}  {_text(figures)}{told}  n {figures.count}")


def _text(figures: Window) -> str:
    if isinstance(figures, Rate):
        lost = f"  lost {figures.lost}" if figures.lost else ""
        return f"{figures.rate:.2f} Hz  {_milliseconds(figures)}{lost}"
    if isinstance(figures, Bandwidth):
        sizes = f"min {data_size(figures.min)} mean {data_size(figures.mean)} max {data_size(figures.max)}"
        return f"{data_size(figures.bandwidth, 'B/s')}  {sizes}  {figures.rate:.2f} Hz"
    if isinstance(figures, Delay):
        return f"mean {figures.mean * 1e3:.3f} {_milliseconds(figures)}"
    assert isinstance(figures, Loss)
    return f"lost {figures.lost} of {figures.count + figures.lost} ({figures.loss:.2%})  in all {figures.total_lost}"


def _milliseconds(figures: Rate | Delay) -> str:
    values = (("min", figures.min), ("max", figures.max), ("std", figures.std), ("jitter", figures.jitter))
    return " ".join(f"{name} {value * 1e3:.3f}" for name, value in values) + " ms"
