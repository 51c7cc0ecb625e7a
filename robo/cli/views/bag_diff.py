"""`robo bag diff`: how two recordings differ."""

import msgspec

from robo import bag
from robo.bag.look.comparison import TopicDifference
from robo.cli.printing import amount, paint, print_json, print_line, print_table
from robo.cli.views.bag_progress import progress
from robo.text import colours
from robo.text.brief import brief


def print_diff(first: str, second: str, *, json: bool) -> int:
    """Print how two recordings differ.

    Returns:
        1 where their topics, types, counts or messages do; times alone do not count.

    Raises:
        BagError: one cannot be read, or is damaged.
    """
    with progress(f"comparing {first} and {second}") as tell:
        found = bag.diff(first, second, tell=tell)
    if json:
        topics = [{**msgspec.to_builtins(topic), "same": topic.same} for topic in found.topics]
        print_json({"paths": found.paths, "same": found.same, "topics": topics})
        return 0 if found.same else 1
    head = ("", "TOPIC", "COUNTS", "DIFFER", "PUBLISHED", "ARRIVED", "WHAT")
    print_table([head, *map(_row, found.topics)], ("ARRIVED", "PUBLISHED"))
    differing = sum(not topic.same for topic in found.topics)
    same = f"{amount(len(found.topics), 'topic')}, all the same"
    print_line(same if found.same else f"{differing} of {amount(len(found.topics), 'topic')} differ")
    return 0 if found.same else 1


def _row(topic: TopicDifference) -> tuple[str, ...]:
    one, other = topic.counts
    return (
        "=" if topic.same else paint("≠", colours.RED),
        topic.name,
        f"{one:,}" if one == other else f"{one:,}, {other:,}",
        f"{topic.differing:,}",
        _change(topic.shift),
        _change(topic.delay),
        _what(topic),
    )


def _change(seconds: float) -> str:
    return f"±{seconds:.3g} s" if seconds else "-"


def _what(topic: TopicDifference) -> str:
    one, other = topic.types
    if not one or not other:
        return f"in the {'first' if one else 'second'} only"
    if one != other:
        return f"{one}, then {other}"
    first = topic.first
    if first is None:
        return "" if topic.counts[0] == topic.counts[1] else "one has more messages"
    field = f"{first.field}: " if first.field else ""
    return brief(f"message {first.index:,}: {field}{first.first}, then {first.second}", 300)
