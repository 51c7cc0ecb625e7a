"""Which managed node somebody means."""

import pytest

from robo.errors import NodeNotFound
from robo.tools.lifecycle import find

NODES = ["/r1/camera", "/r1/gripper", "/r2/camera", "/lamp"]


@pytest.mark.parametrize(
    ("said", "meant"),
    [("gripper", "/r1/gripper"), ("/r2/camera", "/r2/camera"), ("r1/camera", "/r1/camera"), ("lamp", "/lamp")],
)
def test_a_name_that_only_one_has_says_enough(said: str, meant: str) -> None:
    assert find(NODES, said) == meant


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("camera", "several managed nodes are named camera: /r1/camera, /r2/camera"),
        ("griper", "there is no managed node griper; did you mean gripper?"),
        ("/r1/lamp", "there is no managed node /r1/lamp"),
    ],
)
def test_who_means_none_or_several_is_told(said: str, told: str) -> None:
    with pytest.raises(NodeNotFound, match=told.replace("?", r"\?")):
        find(NODES, said)


def test_where_there_is_none_nothing_is_suggested() -> None:
    with pytest.raises(NodeNotFound, match="there is no managed node camera"):
        find([], "camera")
