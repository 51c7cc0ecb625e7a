"""What `robo interface show` prints of a type in ROS."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import robo_messages
from robo.cli.views.interface import print_type
from robo.errors import ContractError
from robo.interfaces.ros_text import whole_text

TREE = """
from robo_messages import Message, message
@message("test_views/Tree")
class Tree(Message):
    below: "list[Tree]" = []
"""


def test_a_type_is_printed_with_the_messages_in_it(capsys: pytest.CaptureFixture[str]) -> None:
    print_type("geometry/TwistStamped", "ros")
    assert capsys.readouterr().out == f"{whole_text('geometry/TwistStamped')}\n"


@pytest.mark.parametrize(
    ("name", "type_hash"),
    [
        ("geometry/Twist", "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"),
        ("std/Trigger", "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"),
    ],
)
def test_the_hash_of_a_type_is_one_line(name: str, type_hash: str, capsys: pytest.CaptureFixture[str]) -> None:
    print_type(name, "type_hash")
    assert capsys.readouterr().out == f"{type_hash}\n"


def test_programs_are_told_the_name_in_ros_and_the_hash_of_each_part(capsys: pytest.CaptureFixture[str]) -> None:
    print_type("std/SetBool", "json")
    request, response = map(json.loads, capsys.readouterr().out.splitlines())
    assert (request["name"], request["ros_type"]) == ("std/SetBool_Request", "std_srvs/srv/SetBool_Request")
    assert request["type_hash"] == "RIHS01_c62fbb99d94e1b25e8ef9e109f9581956bb1b3361a45a4e5810c36a90d29932e"
    assert response["type_hash"] == "RIHS01_d0814e7f7b4880ab77e9c57426c7aa1562ab69f11eef8e2e968812f9cbd0b059"


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A type that ROS cannot have."""
    (tmp_path / "test_views_tree.py").write_text(TREE)
    monkeypatch.syspath_prepend(tmp_path)
    __import__("test_views_tree")
    yield
    del sys.modules["test_views_tree"]


@pytest.mark.usefixtures("tree")
def test_a_type_that_ros_cannot_have_says_so_where_ros_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    for form in ("ros", "type_hash"):
        with pytest.raises(ContractError, match=r"^test_views/Tree.below: ROS has no type that holds itself$"):
            print_type("test_views/Tree", form)
    print_type("test_views/Tree", "json")
    assert json.loads(capsys.readouterr().out)["ros_type"] is None
    assert robo_messages.find_type("test_views/Tree").__module__ == "test_views_tree"
