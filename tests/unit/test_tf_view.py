"""How `robo tf tree` draws frames."""

from robo.cli.views.tf import tree_lines
from robo.tf import FrameInfo


def frame(parent: str, child: str, depth: int, *, rate: float | None = 50.0, static: bool = False) -> FrameInfo:
    return FrameInfo(
        child=child,
        parent=parent,
        static=static,
        rate=None if static else rate,
        newest=0,
        age=None if static else 0.02,
        source="/r1/base",
        depth=depth,
    )


def test_two_trees_with_branches() -> None:
    infos = [
        frame("earth", "map", 1, static=True),
        frame("map", "odom", 2),
        frame("odom", "base_link", 3),
        frame("base_link", "arm", 4),
        frame("arm", "hand", 5),
        frame("base_link", "laser", 4, static=True),
        frame("map", "marker", 2, rate=None),
        frame("lab", "clock", 1, static=True),
        frame("lab", "door", 1, static=True),
    ]
    assert tree_lines(infos) == [
        "earth",
        "└─ map               static, by /r1/base",
        "   ├─ odom           50.0 Hz, 0.02 s old, by /r1/base",
        "   │  └─ base_link   50.0 Hz, 0.02 s old, by /r1/base",
        "   │     ├─ arm      50.0 Hz, 0.02 s old, by /r1/base",
        "   │     │  └─ hand  50.0 Hz, 0.02 s old, by /r1/base",
        "   │     └─ laser    static, by /r1/base",
        "   └─ marker         0.02 s old, by /r1/base",
        "lab",
        "├─ clock             static, by /r1/base",
        "└─ door              static, by /r1/base",
    ]


def test_nothing_is_no_line() -> None:
    assert tree_lines([]) == []
