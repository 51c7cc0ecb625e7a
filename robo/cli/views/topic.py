"""`robo topic list`, `info`, `type` and `find`: printing which topics there are."""

import time

from robo.cli.connection import connect_to_robot, nodes_of
from robo.cli.link import watched
from robo.cli.printing import clear_screen, note, paint, print_json, print_line, print_table
from robo.cli.reach import Reach
from robo.text import colours
from robo.tools import runs, topics
from robo.tools.topics import End, Topic
from robo.wire.keys import is_hidden


def print_topics(reach: Reach, *, verbose: bool, json: bool, watch: bool, interval: float) -> None:
    """Print the topics, once or again and again.

    Raises:
        NodeNotFound: the robot that is named is not there, and it was asked once.
    """
    with connect_to_robot(reach) as session, watched(session, reach) as link:
        while True:
            there = topics.list_topics(session, reach.timeout)
            found = [topic for topic in there if reach.covers(topic.key) and not is_hidden(topic.key)]
            if not found and not watch:
                nodes_of(session, reach)
            found = topics.with_rates(found, runs.processes(session, timeout=topics.RATES_TIMEOUT))
            if watch and not json:
                clear_screen()
            if json:
                for topic in found:
                    print_json(topic)
            elif not found:
                note(link.lost or "no topics: a router answers, and no node is there")
            elif verbose:
                for topic in found:
                    _print_ends(topic)
            else:
                print_table([("TOPIC", "TYPE", "PUB", "SUB", "RATE"), *map(_row, found)])
            if not watch:
                return
            time.sleep(interval)


def _row(topic: Topic) -> tuple[str, ...]:
    return (
        topic.key,
        _types(topic.types),
        str(len(topic.publishers)),
        str(len(topic.subscribers)),
        _rate(topic.rate),
    )


def _print_ends(topic: Topic) -> None:
    print_line(f"{paint(topic.key, colours.BOLD)}  {_types(topic.types)}  {_rate(topic.rate)}")
    for label, who in (("publishers", topic.publishers), ("subscribers", topic.subscribers)):
        print_line(f"  {label:11}  {', '.join(who) or 'none'}")


def print_info(name: str, reach: Reach, *, json: bool) -> None:
    """Print all about one topic.

    Raises:
        TopicNotFound: nobody has it.
    """
    key = reach.one_key(name, "look at")
    with connect_to_robot(reach) as session:
        info = topics.topic_info(session, key, reach.timeout)
    if json:
        print_json(info)
        return
    print_line(f"{paint(info.key, colours.BOLD)}  {_types(info.types)}  {_rate(info.rate)}")
    for label, ends in (("publishers", info.publishers), ("subscribers", info.subscribers)):
        print_line(f"  {label}{'' if ends else '  none'}")
        for end in ends:
            print_line(f"    {_end(end, info.types)}")
    for other in info.others:
        print_line(f"  {other}, which is no node of robo's")
    for problem in (*info.strangers, *info.misfits):
        print_line(f"  {paint('!!', colours.YELLOW)} {problem}")


def _end(end: End, types: list[str]) -> str:
    clash = f"  {end.type}" if len(types) > 1 else ""
    return f"{end.node}{clash}  {end.qos}"


def print_type(name: str, reach: Reach, *, json: bool) -> None:
    """Print the type of a topic; each of them where there are several.

    Raises:
        TopicNotFound: nobody has it.
    """
    key = reach.one_key(name, "look at")
    with connect_to_robot(reach) as session:
        topic = topics.find_topic(topics.list_topics(session, reach.timeout, (key,)), key)
    if json:
        print_json({"key": topic.key, "types": topic.types})
        return
    for type_name in topic.types:
        print_line(type_name)


def print_topics_of(type_name: str, reach: Reach, *, json: bool) -> int:
    """Print the topics of a type.

    Returns:
        1 where there are none.
    """
    with connect_to_robot(reach) as session:
        found = [
            t for t in topics.list_topics(session, reach.timeout, ()) if type_name in t.types and reach.covers(t.key)
        ]
    for topic in found:
        if json:
            print_json(topic)
        else:
            print_line(topic.key)
    if not found:
        note(f"no topic has the type {type_name}")
    return 0 if found else 1


def _types(types: list[str]) -> str:
    return paint(f"clash: {' ≠ '.join(types)}", colours.RED) if len(types) > 1 else (types[0] if types else "-")


def _rate(rate: float | None) -> str:
    return "-" if rate is None else f"{rate:.1f} Hz"
