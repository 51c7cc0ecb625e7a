"""Packages of ROS with random messages in each other, by a seed: what `robo interface import` makes types of."""

import random
from collections.abc import Sequence

NUMBERS = (
    "bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
    "float32", "float64",
)  # fmt: skip
SHIPPED = ("std_msgs/Header", "geometry_msgs/Point", "geometry_msgs/Twist", "std_msgs/Empty", "sensor_msgs/Image")
MOST_FIXED = 3


def definitions(seed: object, count: int, *, wide: bool = True) -> dict[str, str]:
    """Files of a package `random_msgs`, by their paths: messages `A0` … in which earlier ones stand.

    Args:
        seed: of the random numbers.
        count: of messages.
        wide: whether they have texts of the type `wstring`, too.
    """
    rng = random.Random(str(seed))
    texts = ("string", "string<=5", *(("wstring", "wstring<=4") if wide else ()))
    files = {}
    for number in range(count):
        own = [f"A{i}" for i in range(number)]
        fields = [f"{_type(rng, texts, own)} field_{i}\n" for i in range(rng.choice((0, 1, 2, 3, 5, 8)))]
        files[f"random_msgs/msg/A{number}.msg"] = "".join(fields)
    return files


def _type(rng: random.Random, texts: Sequence[str], own: Sequence[str]) -> str:
    word = rng.choice((*NUMBERS, *texts, *texts, *rng.sample(SHIPPED, 2), *own[-3:]))
    array = rng.choice(("", "", "", "[]", f"[{rng.randint(1, MOST_FIXED)}]", f"[<={rng.randint(1, MOST_FIXED)}]"))
    return f"{word}{array}"
