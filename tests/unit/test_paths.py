"""Maps within maps as paths, and back."""

from collections.abc import Mapping

from hypothesis import given
from hypothesis import strategies as st

from robo.text.choices import choice_of
from robo.text.paths import nested, unnested

names = st.text("ab", min_size=1, max_size=2)
trees = st.recursive(
    st.dictionaries(names, st.integers(), max_size=3),
    lambda inner: st.dictionaries(names, inner | st.integers(), max_size=3),
)


def test_a_path_leads_to_each_value() -> None:
    tree = {"a": {"b": 1, "c": {"d": [2]}}, "e": {}}
    assert dict(unnested(tree, ".")) == {"a.b": 1, "a.c.d": [2], "e": {}}


def test_whoever_asks_says_which_map_is_a_value() -> None:
    seen: list[str] = []

    def is_opened(path: str, inner: Mapping[str, object]) -> bool:
        seen.append(path)
        return "whole" not in inner

    tree = {"a": {"b": {"whole": 1}, "c": {"d": 2}}}
    assert dict(unnested(tree, "/", is_opened)) == {"a/b": {"whole": 1}, "a/c/d": 2}
    assert seen == ["a", "a/b", "a/c"], "it is asked by the whole path"


@given(trees)
def test_there_and_back_nothing_is_lost(tree: dict[str, object]) -> None:
    assert nested(dict(unnested(tree, ".")), ".") == tree


def test_a_choice_is_the_word_itself_or_none() -> None:
    assert choice_of("sub", ("pub", "sub")) == "sub"
    assert choice_of("su", ("pub", "sub")) is None
    assert choice_of("", ()) is None
