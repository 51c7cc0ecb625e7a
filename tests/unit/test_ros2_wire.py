"""Keys, tokens, qualities and attachments of rmw_zenoh, and the rules of what crosses."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.bridges.ros2 import quality, stamps, tokens
from robo.bridges.ros2.quality import RosQoS
from robo.bridges.ros2.rules import Rules, crossings_of
from robo.bridges.ros2.sources import Commander, Numbers
from robo.bridges.ros2.tally import Tally
from robo.bridges.ros2.tokens import EndToken, NodeToken
from robo.errors import UsageError
from robo.launch.plan import CrossingPlan, Ros2Plan
from robo.wire.qos import KEEP_ALL, QoS

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
SESSION = "aac3178e146ba6f1fc6e6a4085e77f21"
STRING = "std_msgs::msg::dds_::String_"
LISTENER = f"@ros2_lv/2/{SESSION}/0/10/MS/%/%/listener/%chatter/{STRING}/{HASH}/::,10:,:,:,,"
WORDS = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
NAMES = st.lists(WORDS, min_size=1, max_size=4).map("/".join)


def test_a_node_of_rmw_zenohs_description_is_read() -> None:
    token = tokens.parse(f"@ros2_lv/2/{SESSION}/0/0/NN/%/%/listener")
    assert token == NodeToken(2, SESSION, 0, "", "listener")
    assert token.full_name == "/listener"


def test_an_end_of_rmw_zenohs_description_is_read() -> None:
    token = tokens.parse(LISTENER)
    assert isinstance(token, EndToken)
    assert (token.kind, token.topic, token.type, token.hash) == ("MS", "chatter", STRING, HASH)
    assert token.quality == RosQoS(depth=10)
    assert token.data_key == f"2/chatter/{STRING}/{HASH}"
    assert token.key() == token.said == LISTENER


def test_what_newer_releases_add_to_an_end_is_left_alone() -> None:
    token = tokens.parse(f"{LISTENER}/cuda,cpu")
    assert isinstance(token, EndToken)
    assert token.said.endswith("/cuda,cpu")  # ROS's id of the end is a hash of all of it


@pytest.mark.parametrize(
    "key",
    [
        "",
        "@ros2_lv",
        "@robo/r1/node/a/b/1/h",
        f"@ros2_lv/233/{SESSION}/0/0/NN/%/%/listener",
        f"@ros2_lv/²/{SESSION}/0/0/NN/%/%/listener",
        f"@ros2_lv/2/{SESSION}/0/1/NN/%/%/listener",
        f"@ros2_lv/2/{SESSION}/0/0/NN/%/r1/listener",
        f"@ros2_lv/2/{SESSION}/0/0/NN/%/%r1%%x/listener",
        f"@ros2_lv/2/{SESSION}/0/0/NN/%/%/a b",
        "@ros2_lv/2/NOTHEX/0/0/NN/%/%/listener",
        LISTENER.replace("/MS/", "/XX/"),
        LISTENER.replace("::,10", "::,x"),
        LISTENER.replace(HASH, "RIHS01_abc"),
        LISTENER.replace(STRING, "String"),
        LISTENER.replace("%chatter", "%"),
        LISTENER.replace("%chatter", "%" + "c" * 3000),
    ],
)
def test_what_spells_no_token_is_none(key: str) -> None:
    assert tokens.parse(key) is None


@given(NAMES, WORDS, NAMES, st.sampled_from(tokens.KINDS), st.integers(0, 232), st.integers(1, 10**8))
def test_tokens_survive_their_way(
    namespace: str, name: str, topic: str, kind: tokens.Kind, domain: int, n: int
) -> None:
    node = NodeToken(domain, SESSION, n, namespace, name)
    assert tokens.parse(node.key()) == node
    end = EndToken(node, n, kind, topic, STRING, HASH, RosQoS(transient_local=True, depth=3))
    read = tokens.parse(end.key())
    assert isinstance(read, EndToken)
    assert read.key() == end.key()
    found = tokens.parse_data_key(end.data_key, domain)
    assert found is not None
    assert tuple(found) == (topic, STRING, HASH)


@given(st.text(max_size=80))
def test_any_text_is_read_or_left_out(text: str) -> None:
    tokens.parse(text)
    tokens.parse(f"@ros2_lv/{text}")
    tokens.parse_data_key(f"0/{text}", 0)
    quality.from_word(text)


@pytest.mark.parametrize(
    ("word", "found"),
    [
        ("::,10:,:,:,,", RosQoS(depth=10)),
        ("2::,5:,:,:,,", RosQoS(reliable=False, depth=5)),
        (":1:,1:,:,:,,", RosQoS(transient_local=True, depth=1)),
        ("::2,42:,:,:,,", RosQoS(keep_all=True)),
        ("::,:,:,:,,", RosQoS()),
        ("1:2:1,10:0,500000000:1,0:1,9223372036,854775807", RosQoS(depth=10, deadline=0.5, lifespan=1.0)),
        ("::,10:9223372036,854775807:,:,,", RosQoS(depth=10)),
        ("::10:,:,:,,", None),
        ("::,-1:,:,:,,", None),
        ("", None),
    ],
)
def test_qualities_are_read(word: str, found: RosQoS | None) -> None:
    assert quality.from_word(word) == found


@given(st.booleans(), st.booleans(), st.booleans(), st.integers(1, 10**6), st.none() | st.floats(1e-3, 1e6))
def test_qualities_survive_their_way(
    reliable: bool, latched: bool, keeps: bool, depth: int, time: float | None
) -> None:
    said = RosQoS(
        reliable=reliable, transient_local=latched, keep_all=keeps, depth=depth, deadline=time and round(time, 3)
    )
    read = quality.from_word(said.word)
    assert read is not None
    assert read.word == said.word


def test_what_a_quality_is_on_the_other_side() -> None:
    assert quality.to_ros(QoS.LATCHED) == RosQoS(transient_local=True, depth=1)
    assert quality.to_ros(QoS(depth=KEEP_ALL)).keep_all
    assert quality.to_ros(QoS(depth=5), "best_effort", "transient_local", 3) == RosQoS(
        reliable=False, transient_local=True, depth=3
    )
    assert quality.to_robo(RosQoS(transient_local=True, depth=10**6)).latched
    assert quality.to_robo(RosQoS(transient_local=True, depth=10**6)).depth == 1000
    assert quality.to_robo(RosQoS(keep_all=True)).depth == KEEP_ALL


def test_an_attachment_is_33_bytes() -> None:
    data = stamps.pack(1, 2, bytes(range(16)))
    assert data == struct.pack("<qqB", 1, 2, 16) + bytes(range(16))
    assert stamps.unpack(data) == stamps.Stamp(1, 2, bytes(range(16)))
    assert stamps.Stamp(1, 2, bytes(range(16))).packed() == data
    for wrong in (b"", data[:-1], data + b"\0", struct.pack("<qqB", 1, 2, 15) + bytes(16)):
        assert stamps.unpack(wrong) is None


def test_an_id_is_the_hash_of_the_token_low_half_first() -> None:
    xxhash = pytest.importorskip("xxhash", reason="the extra ros2 is not installed")
    from robo.bridges.ros2.gids import gid_of

    whole = xxhash.xxh3_128_intdigest(LISTENER.encode())
    assert gid_of(LISTENER) == struct.pack("<QQ", whole & (2**64 - 1), whole >> 64)


def named(rules: Rules, key: str) -> str | None:
    found = rules.to_ros(key)
    return found.name if found is not None else None


def test_names_cross_by_rules_and_exact_ones_come_first() -> None:
    rules = Rules(
        {
            "**": CrossingPlan(),
            "odom": CrossingPlan(ros="/odom"),
            "cameras/*/image": CrossingPlan(ros="/cam_*/image_raw"),
            "cmd_ros": CrossingPlan(ros="/cmd_vel", direction="from_ros"),
        },
        "r1",
    )
    assert named(rules, "r1/odom") == "odom"
    assert named(rules, "r1/scan") == "r1/scan"
    assert named(rules, "r1/cameras/left/image") == "r1/cameras/left/image"  # the first pattern that fits
    assert named(rules, "r1/tf") == "tf"
    assert named(rules, "r2/scan") is None
    for own in ("r1/log", "r1/parameter_events", "r1/follow/_action/status", "r1/cmd_ros"):
        assert named(rules, own) is None
    found = rules.from_ros("cmd_vel")
    assert found is not None
    assert found.key == "r1/cmd_ros"
    assert rules.from_ros("odom") is None
    assert rules.key_in_robo("odom", says=False) == "r1/odom"
    assert rules.key_in_robo("cmd_vel", says=True) == "r1/cmd_ros"


def test_patterns_keep_what_they_stand_for_in_both_directions() -> None:
    rules = Rules({"**": CrossingPlan(ros="/**", direction="both"), "/x/**/y": CrossingPlan(ros="/**/z")}, "r1")
    assert named(rules, "r1/a/b") == "a/b"
    found = rules.from_ros("a/b")
    assert found is not None
    assert found.key == "r1/a/b"
    assert named(rules, "x/p/q/y") == "p/q/z"
    assert named(rules, "x/y") == "z"
    assert rules.from_ros("log") is None  # robo's own


def test_all_that_is_wrong_with_rules_is_told_at_once() -> None:
    with pytest.raises(UsageError) as caught:
        crossings_of(
            Ros2Plan(topics={"a": CrossingPlan(ros="/x"), "b": CrossingPlan(ros="/x"), "c/*": CrossingPlan(ros="/c")}),
            "r1",
        )
    assert str(caught.value).splitlines() == [
        "c/*: /c needs the same * and ** in the same order",
        "/r1/a and /r1/b are both /x in ROS: leave one of them out",
    ]


def test_without_rules_all_goes_to_ros_and_nothing_comes_from_there() -> None:
    crossings = crossings_of(Ros2Plan(), "r1")
    assert named(crossings.topics, "r1/odom") == "r1/odom"
    assert named(crossings.topics, "clock") == "clock"
    assert crossings.topics.from_ros("r1/odom") is None
    assert crossings.services.from_ros("r1/reset") is None


def test_numbers_tell_losses_and_what_comes_twice() -> None:
    numbers = Numbers()
    found = [numbers.missed("a", number, once=True) for number in (5, 6, 9, 9, 8, 10)]
    assert found == [0, 0, 2, -1, -1, 0]
    assert numbers.missed("b", 1, once=False) == 0
    assert numbers.missed("b", 1, once=False) == 0  # a publisher that has begun anew
    for number in range(5_000):
        numbers.missed(str(number), 1, once=True)
    assert not numbers.knows("a")


def test_one_commander_at_a_time_is_let_through() -> None:
    told: list[str] = []
    commander = Commander(told.append)
    assert commander.admits("1", "/pad", 0.0)
    assert not commander.admits("2", "/other", 0.1)
    assert commander.admits("1", "/pad", 0.2)
    assert told == ["/other"]
    assert commander.admits("2", "/other", 1.0)  # the first one has been silent


def test_faults_are_told_once_and_bounded() -> None:
    told: list[str] = []
    tally = Tally(told.append)
    for number in range(5_000):
        tally.fault(f"{number % 3_000}", f"wrong {number % 3_000}")
    assert len(told) == len(tally.faults()) == 2_000
    tally.mend("1")
    tally.fault("1", "wrong 1")
    assert len(told) == 2_001
    for number in range(5_000):
        tally.of(f"r1/{number}", str(number), "to_ros").crossed += 1
    assert len(tally.look()) <= 2_001
