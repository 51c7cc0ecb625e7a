"""Replaying in a test of pytest."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from robo.bag.regression.report import ReplayReport, lines
from robo.testing.regression.judge import RUNS, Request, judge, nodes_of


class ReplayDiffers(AssertionError):
    """Nodes say something else than a recording has, are not deterministic, or have failed."""

    def __init__(self, report: ReplayReport) -> None:
        super().__init__("\n".join(lines(report)))
        self.report = report
        """What was found."""


def replay(
    bag: str | os.PathLike[str],
    *nodes: str | type,
    manifest: str | os.PathLike[str] | None = None,
    robot_name: str | None = None,
    arguments: Mapping[str, object] | None = None,
    parameters: Mapping[str, Any] | None = None,
    tolerances: str | os.PathLike[str] | None = None,
    ignore: Sequence[str] = (),
    runs: int = RUNS,
    plots: str | os.PathLike[str] | None = None,
    patience: float = 10.0,
) -> ReplayReport:
    """Feed a recording to nodes as they are now, and fail where they say something else than was recorded.

        def test_the_tracker_says_what_it_said() -> None:
            replay("drive.mcap", "position_tracker", manifest="robot.yaml")

    Args:
        bag: the recording.
        nodes: classes, or names as `robo replay-test --node` takes them.
        manifest: says how nodes are made, as for `robo up`; robot.yaml where a node is named.
        robot_name: the robot's; by default that of the recording.
        arguments: of the manifest.
        parameters: values over all others, of all these nodes.
        tolerances: a file; without, all is compared bit for bit.
        ignore: fields that do not count: `header.stamp`, `r1/odom:header.stamp`.
        runs: so many, which have to say the same before they are compared with the recording.
        plots: a folder for pictures of fields that differ.
        patience: how long a callback may take, s of the wall clock.

    Returns:
        What was found.

    Raises:
        ReplayDiffers: it is not as it was; tells where.
        RoboError: what is asked makes no sense.
    """
    report = judge(
        Request(
            bag=os.fspath(bag),
            nodes=nodes_of(nodes),
            manifest=_path(manifest),
            robot=robot_name,
            arguments={name: _text(value) for name, value in (arguments or {}).items()},
            parameters=dict(parameters or {}),
            tolerances=_path(tolerances),
            ignored=list(ignore),
            runs=runs,
            plots=_path(plots),
            patience=patience,
        )
    )
    if not report.fine:
        raise ReplayDiffers(report)
    return report


def _path(path: str | os.PathLike[str] | None) -> str | None:
    return None if path is None else os.fspath(path)


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
