"""A skeleton prints what the template would have printed, whatever the template does."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jinja2 import Environment, StrictUndefined, Template

from pilotgen.decks.template_cache import Part, TemplateCache

ENVIRONMENT = Environment(undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True)
TEMPLATES = {
    "prints": "a {{ a }}, {{ b.x ~ '!' }} {% for k in c %}[{{ k }} {{ a }}]{% endfor %}\n{{ n + 1 }}",
    "compares": "{% if a == 'x' %}is x{% else %}is {{ a }}{% endif %} {% for k in c %}{{ k }}{% endfor %}{{ b.x }}",
    "compares by name": "{% if b.x in ('', '1', 'x') %}few{% endif %}{{ a }}{{ c | length }}",
    "truth": "{{ a if a else 'nothing' }} {{ b.x or 'empty' }} {% if flag %}{{ c }}{% endif %}",
    "transforms": "{{ a | upper }} {{ b.x | length }} {{ a[:2] }}",
    "copies": "{% set copy = a %}{{ copy }}{{ copy }}{% macro m(t) %}<{{ t }}>{% endmacro %}{{ m(b.x) }}{{ m(m(a)) }}",
    "nothing": "no variables\n",
}
TEXTS = st.sampled_from(["", "x", "1", "y\n", "-1.5e-07", "\x02aZ1\x03", "Straße"])


def count_renderings(template: Template) -> list[int]:
    """Renderings so far, counted from now on."""
    calls, render = [0], template.render

    def counted(*args: Any, **kwargs: Any) -> str:
        calls[0] += 1
        return render(*args, **kwargs)

    template.render = counted  # type: ignore[method-assign]
    return calls


@pytest.mark.parametrize("name", list(TEMPLATES))
@given(st.lists(st.tuples(TEXTS, TEXTS, st.lists(TEXTS, max_size=2), st.booleans()), min_size=1, max_size=12))
def test_same_text_as_the_template(name: str, rows: list[tuple[str, str, list[str], bool]]) -> None:
    template = ENVIRONMENT.from_string(TEMPLATES[name])
    skeletons = TemplateCache(template)
    for a, x, c, flag in rows:
        variables = {"a": a, "b": SimpleNamespace(x=x), "c": c, "n": 3, "flag": flag}
        assert skeletons.render(**variables) == template.render(variables)


def test_a_known_structure_is_not_rendered_again() -> None:
    template = ENVIRONMENT.from_string(TEMPLATES["compares"])
    skeletons, calls = TemplateCache(template), count_renderings(template)
    for i in range(50):
        skeletons.render(a=f"{i}" if i % 2 else "x", b=SimpleNamespace(x="2"), c=["3"])
    assert calls[0] > 4  # the comparison makes every `a` a structure of its own
    template = ENVIRONMENT.from_string(TEMPLATES["prints"])
    skeletons, calls = TemplateCache(template), count_renderings(template)
    for i in range(50):
        skeletons.render(a=f"{i}", b=SimpleNamespace(x="2"), c=["3", f"{-i}"], n=2)
    assert calls[0] == 3  # twice to find it worth while, once with markers


def test_a_part_prints_as_a_namespace_does() -> None:
    template = ENVIRONMENT.from_string("{{ p.x }} {% for k in p.c %}{{ k }}{% endfor %}{{ q }}")
    skeletons = TemplateCache(template)
    for i in range(12):
        part = Part(x=f"{i}", c=["3"] * (i % 3))
        for q in ("u", "v"):  # two decks, one part
            plain = SimpleNamespace(**part.__dict__)
            assert skeletons.render(p=part, q=q) == template.render(p=plain, q=q) == skeletons.render(p=plain, q=q)


def test_other_variables_are_refused() -> None:
    with pytest.raises(TypeError, match="not float"):
        TemplateCache(ENVIRONMENT.from_string("{{ a }}")).render(a=1.5)
