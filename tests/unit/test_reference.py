"""The pages of docs/reference say what the code says."""

from pathlib import Path

import msgspec
import pytest
from typer.main import get_command

import robo_messages
from docs_tools.reference import commands, manifest, messages, nodes, pages, reports
from docs_tools.reference.markdown import Gap, code, described, paragraphs, prose, table
from robo import environment
from robo.cli.app import app
from robo.interfaces.catalogue import FieldInfo
from robo.launch.forms import FILLED, SCALAR
from robo.node.contract import contract_of
from robo.wire import keys
from tests.unit import test_docs


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return pages.pages()


def test_no_page_is_out_of_date(made: dict[str, str]) -> None:
    written = {file.name: file.read_text(encoding="utf-8") for file in pages.FOLDER.glob("*.md")}
    stale = sorted(name for name in made.keys() | written.keys() if made.get(name) != written.get(name))
    assert stale == [], f"in docs/reference, {', '.join(stale)} is not what the code says; run {pages.COMMAND}"


def test_a_page_is_the_same_on_every_machine(
    made: dict[str, str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.chdir(tmp_path)
    assert pages.pages() == made
    for text in made.values():
        assert str(Path.home()) not in text
        assert str(Path(__file__).parents[2]) not in text
        assert " at 0x" not in text


@pytest.mark.parametrize("name", [file.name for file in sorted(pages.FOLDER.glob("*.md"))])
def test_links_lead_somewhere(name: str) -> None:
    test_docs.test_links_lead_somewhere(pages.FOLDER / name)


def test_everything_is_listed(made: dict[str, str]) -> None:
    for name in messages.shipped():
        service = name.removesuffix("_Request").removesuffix("_Response")
        assert f"\n## {service}\n" in made[messages.page_of(name.partition("/")[0])]
    for path, _ in commands.verbs(get_command(app)):
        assert f"\n### robo {' '.join(path)}\n" in made["commands.md"]
    for name, value in vars(environment).items():
        assert not name.endswith("_VARIABLE") or f"| `{value}` |" in made["environment.md"]
    for node in map(contract_of, nodes.shipped()):
        for parameter in node.parameters:
            assert f"`{parameter.name}`" in made["nodes.md"]
    for token in (keys.NodeToken, keys.ClaimToken, keys.EndpointToken, keys.SupervisorToken):
        assert f"### {token.__name__}\n" in made["keys.md"]
    for struct in reports.structs():
        assert f"\n## {struct.__name__}\n" in made["reports.md"]
    for verb in ("ps", "sites", "down"):
        assert f"\n| `{verb}` |" in made["reports.md"]
    for name in made.keys() - {"index.md"}:
        assert f"]({name})" in made["index.md"]


@pytest.mark.parametrize("name", messages.shipped())
def test_an_example_is_a_message_of_its_type(name: str) -> None:
    type_ = robo_messages.find_type(name)
    text = messages.example_text(type_)
    message = robo_messages.decode_json(text, type_)
    assert list(msgspec.json.decode(text)) == list(type_.__struct_fields__)
    assert robo_messages.decode(robo_messages.encode(message), type_) is not None
    assert max(map(len, text.splitlines())) <= messages.WIDTH


def test_what_has_no_description_or_no_unit_is_refused() -> None:
    with pytest.raises(Gap, match=r"parameter x\.y has no description"):
        described(" ", "parameter x.y")
    number = msgspec.inspect.FloatType()
    many = msgspec.inspect.ListType(number)
    for info in (number, many, msgspec.inspect.Metadata(many)):
        with pytest.raises(Gap, match=r"a/B\.speed: 'How fast\.' says no unit"):
            messages.described_field("a/B", FieldInfo("speed", "float", 0.0, "How fast."), info)
        for text in ("m/s.", "How fast, m/s; 0 to stand.", "A part, 0 to 1."):
            assert messages.described_field("a/B", FieldInfo("speed", "float", 0.0, text), info) == text


def test_ratios_are_the_only_parameters_without_a_unit() -> None:
    known = {f"{node.name}.{one.name}" for node in map(contract_of, nodes.shipped()) for one in node.parameters}
    assert known >= nodes.WITHOUT_UNIT


@pytest.mark.parametrize(
    ("schema", "text"),
    [
        ({"anyOf": [{"type": "number", "minimum": 0, "maximum": 1}, FILLED]}, "number, 0 to 1"),
        ({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}, "text, or list of them"),
        ({"type": "array", "items": SCALAR}, "list of values"),
        ({"type": ["boolean", "string"]}, "`true`, `false` or an expression"),
        ({"enum": ["a", "b"]}, "`a`, `b`"),
        ({"type": "object", "additionalProperties": {"$ref": "#/$defs/arg"}}, "map from names to [arg](#arg)"),
        ({"type": "integer", "minimum": 1, "maximum": 1_000_000_000}, "whole number, at least 1"),
    ],
)
def test_values_of_a_manifest_in_words(schema: dict[str, object], text: str) -> None:
    assert manifest.form_text(schema) == text


def test_what_markdown_would_take_for_its_own_is_shown() -> None:
    assert prose("a <b> **c** | `<d> *` x_y") == "a &lt;b&gt; \\*\\*c\\*\\* \\| `<d> *` x_y"
    assert (code("a_b"), code("A|B"), code("")) == ("`a_b`", "<code>A&#124;B</code>", "")
    assert table(("a", "b", "c"), [("1", "", "3")]) == ["| a | c |", "|---|---|", "| 1 | 3 |", ""]
    assert table(("a",), []) == []
    assert paragraphs("One\nline.\n\n    code *\n\nTwo.") == [
        "One line.", "", "```text\ncode *\n```", "", "Two.", "",
    ]  # fmt: skip
