"""Parameters of many nodes: who is meant, and what each has answered."""

import threading

import pytest

from robo.errors import NodeNotFound, NodeUnreachable, ParameterError, UsageError
from robo.tools.parameters_of_many import AT_ONCE, Answer, each, is_pattern, meant
from robo.wire.keys import NodeToken


def token(full_name: str) -> NodeToken:
    namespace, _, node = full_name.strip("/").rpartition("/")
    return NodeToken(namespace, node, "m:C", 1, "pi")


THERE = [token(name) for name in ("/r1/base", "/r1/arm/base", "/r2/base", "/r2/tracker", "/alone")]


@pytest.mark.parametrize(
    ("pattern", "robot", "found"),
    [
        ("r*/base", "", ["/r1/base", "/r2/base"]),
        ("/r*/base", "", ["/r1/base", "/r2/base"]),
        ("**/base", "", ["/r1/base", "/r1/arm/base", "/r2/base"]),
        ("r1/**", "", ["/r1/base", "/r1/arm/base"]),
        ("*", "", ["/alone"]),
        ("b*", "r1", ["/r1/base"]),
    ],
)
def test_patterns_match_full_names_as_those_of_topics_do(pattern: str, robot: str, found: list[str]) -> None:
    assert is_pattern(pattern)
    assert [one.full_name for one in meant(THERE, pattern, robot)] == found


def test_a_pattern_that_means_nobody_is_told_with_what_it_may_mean() -> None:
    with pytest.raises(NodeNotFound, match=r"patterns are of full names: did you mean '\*\*/track\*'\?"):
        meant(THERE, "track*")
    with pytest.raises(NodeNotFound, match=r"no node matches r\*/trackr; did you mean r2/tracker\?"):
        meant(THERE, "r*/trackr")
    with pytest.raises(UsageError, match=r"node 'r\*\*/base' makes no sense"):
        meant(THERE, "r**/base")


def test_a_plain_name_is_no_pattern() -> None:
    assert not is_pattern("/r1/base")


def test_each_answers_for_itself_in_order() -> None:
    def ask(node: NodeToken) -> dict[str, object]:
        if node.node == "tracker":
            raise ParameterError("speed: at most 1")
        if node.node == "alone":
            raise NodeUnreachable("it does not answer")
        return {"speed": 0.3}

    assert each(THERE[2:], ask) == [
        Answer(node="/r2/base", answer="ok", values={"speed": 0.3}),
        Answer(node="/r2/tracker", answer="refused", reason="speed: at most 1"),
        Answer(node="/alone", answer="silent", reason="it does not answer"),
    ]


def test_several_are_asked_at_once_and_never_more() -> None:
    together = threading.Barrier(AT_ONCE)
    lock, counts = threading.Lock(), [0, 0]

    def ask(_: NodeToken) -> dict[str, object]:
        with lock:
            counts[0] += 1
            counts[1] = max(counts)
        together.wait(20)  # the next ones come when these have gone
        with lock:
            counts[0] -= 1
        return {}

    assert len(each(THERE[:1] * (2 * AT_ONCE), ask)) == 2 * AT_ONCE
    assert counts[1] <= AT_ONCE


def test_another_mistake_is_not_hidden() -> None:
    def ask(_: NodeToken) -> dict[str, object]:
        raise KeyError("x")

    with pytest.raises(KeyError):
        each(THERE, ask)
