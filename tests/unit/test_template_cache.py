"""A cached template prints what the template would have printed, or refuses.

SPDX-License-Identifier: BSD-3-Clause
"""

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
    "decides": "{% if flag %}is {{ a }}{% else %}{{ b.x }}{% endif %} {% for k in c %}{{ k }}{% endfor %}{{ n }}",
    "copies": "{% set copy = a %}{{ copy }}{{ copy }}{% macro m(t) %}<{{ t }}>{% endmacro %}{{ m(b.x) }}{{ m(m(a)) }}",
    "nothing": "no variables\n",
}
TEXTS = st.sampled_from(["", "x", "1", "y\n", "-1.5e-07", "\x021\x03", "Straße"])


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
    cache = TemplateCache(template)
    for a, x, c, flag in rows:
        variables = {"a": a, "b": SimpleNamespace(x=x), "c": c, "n": 3, "flag": flag}
        assert cache.render(**variables) == template.render(variables)


def test_a_structure_is_rendered_once() -> None:
    template = ENVIRONMENT.from_string(TEMPLATES["prints"])
    cache, calls = TemplateCache(template), count_renderings(template)
    for i in range(50):
        cache.render(a=f"{i}", b=SimpleNamespace(x="2"), c=["3", f"{-i}"], n=2)
    assert calls[0] == 1
    cache.render(a="1", b=SimpleNamespace(x="2"), c=["3"], n=2)
    assert calls[0] == 2


def test_a_part_prints_as_a_namespace_does() -> None:
    template = ENVIRONMENT.from_string("{{ p.x }} {% for k in p.c %}{{ k }}{% endfor %}{{ q }}")
    cache = TemplateCache(template)
    for i in range(12):
        part = Part(x=f"{i}", c=["3"] * (i % 3))
        for q in ("u", "v"):  # two decks, one part
            plain = SimpleNamespace(**part.__dict__)
            assert cache.render(p=part, q=q) == template.render(p=plain, q=q) == cache.render(p=plain, q=q)


@pytest.mark.parametrize(
    "text",
    [
        "{% if a == 'x' %}is x{% endif %}",
        "{% if a in ('x', 'y') %}is x{% endif %}",
        "{{ a if a else 'nothing' }}",
        "{{ a or 'nothing' }}",
        "{{ a | length }}",
        "{{ a | upper }}",
        "{{ a[:2] }}",
        "{% for letter in a %}{{ letter }}{% endfor %}",
    ],
)
def test_a_template_that_looks_into_a_text_is_refused(text: str) -> None:
    with pytest.raises(TypeError, match=r"looks into a text|transforms a text|not iterable|no len"):
        TemplateCache(ENVIRONMENT.from_string(text)).render(a="x")


def test_other_variables_are_refused() -> None:
    with pytest.raises(TypeError, match="not float"):
        TemplateCache(ENVIRONMENT.from_string("{{ a }}")).render(a=1.5)
