"""What stays out of a process, and comes in all the same where it is used."""

import platform
import subprocess
import sys

USED_LATER = """\
import sys
from robo.process import lean

lean.import_msgspec()
import msgspec
import robo.process.runner

out = ("msgspec.inspect", "msgspec._json_schema", "msgspec.toml", "msgspec.yaml", "platform")
print([name for name in out if hasattr(sys.modules[name], "__file__")])
print(msgspec.json.schema(int), msgspec.toml.decode("a = 1"))
import platform
print(platform.system() == sys.modules["platform"].system(), bool(platform.python_version()), platform.system())
print(msgspec.inspect.type_info(int).gt)
from msgspec import inspect
print(inspect is sys.modules["msgspec.inspect"], inspect.__file__.rpartition("/")[2])
import robo_messages
print("linear" in robo_messages.json_schema("geometry/Twist")["$defs"]["Twist"]["properties"])
"""


def run(script: str) -> list[str]:
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split("\n")


def test_what_makes_schemas_is_read_once_it_is_used() -> None:
    system = platform.system()
    assert run(USED_LATER)[:6] == [
        "[]",
        "{'type': 'integer'} {'a': 1}",
        f"True True {system}",
        "None",
        "True inspect.py",
        "True",
    ]


def test_what_is_there_already_stays() -> None:
    script = "import msgspec.inspect as there, sys; from robo.process import lean; lean.import_msgspec()\n"
    assert run(script + "print(sys.modules['msgspec.inspect'] is there)")[0] == "True"
