"""The section `uncertain` of a study: what is not known of one pilot. Its rows of the schema, and their distributions.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.objectives import quantile, quantiles
from pilotgen.study.fields import ByName, Choice, Field, Matrix, Mistake, Section, Value, Whole, Words
from pilotgen.study.wording import decimal_comma, did_you_mean, shown
from pilotgen.study.yaml_file import bundled

SETS = ("cushion", "posture", "reflex", "strength", "task", "torso")  # of pilotgen/data/uncertain.yaml
KEYS: Mapping[str, tuple[str, ...]] = {  # distribution -> its numbers
    "normal": ("mean", "deviation"),
    "lognormal": ("median", "factor"),
    "uniform": ("lower", "upper"),
    "triangular": ("lower", "mode", "upper"),
    "words": ("weights",),
}
TRUNCATED = ("normal", "lognormal")  # may have `within`
VALUE, FACTOR, OFFSET = "value", "factor", "offset"  # what is drawn
RARE = 1e-6  # share of a distribution that may lie where no number of a study can be; it is not drawn

GROUP = "{numbers: [name, name], correlation: 0.8}"

Distribution = dict[str, Any]  # `distribution`, its numbers, `as`, and perhaps `within`


@dataclass(frozen=True)
class Groups(Field):
    """A list of mappings `{numbers: [name, name, ...], correlation: number or matrix}`."""

    def check(self, what: str, data: Any) -> list[dict[str, Any]]:
        """Return the groups. StudyError for anything else."""
        if not isinstance(data, list) or not data:
            raise StudyError(f"{what} must be a list of {GROUP}")
        key, equals, _ = what.rpartition(" = ")
        return [self._group(f"{key}[{k}] = {shown(one)}" if equals else what, one) for k, one in enumerate(data)]

    def _group(self, what: str, data: Any) -> dict[str, Any]:
        if not isinstance(data, dict) or set(data) != {"numbers", "correlation"}:
            raise StudyError(f"{what} must be {GROUP}")
        names, given = data["numbers"], data["correlation"]
        if not isinstance(names, list) or len(names) < 2 or not all(isinstance(name, str) for name in names):
            raise StudyError(f"{what} needs a list of two numbers or more in numbers")
        if isinstance(given, list):
            rows = Matrix(len(names)).check(f"{what}: correlation", given)
        elif isinstance(given, bool) or not isinstance(given, int | float):
            raise StudyError(f"{what}: correlation is not a number; one number, or a row for each, is wanted")
        else:
            rows = [[1.0 if j == k else float(given) for k in range(len(names))] for j in range(len(names))]
        if any(rows[k][k] != 1.0 for k in range(len(rows))) or any(abs(entry) > 1.0 for row in rows for entry in row):
            raise StudyError(f"{what}: a correlation is from -1 to 1, and 1 of a number with itself")
        return {"numbers": list(names), "correlation": rows if isinstance(given, list) else float(given)}


def uncertain_rows() -> dict[str, Field]:
    """Rows of the section for the schema."""
    return {
        "uncertain": Section(
            default=None,
            null=True,
            words=lambda: SETS,
            meaning="what is not known of one pilot, for `pilotgen pilot --uncertain` and robust searches",
        ),
        "uncertain.sets": Words(SETS, default=(), meaning="bundled sets of distributions"),
        "uncertain.variables": ByName(
            entry=distribution, words=True, default=None, meaning="number or word -> its distribution"
        ),
        "uncertain.correlated": Groups(default=None, meaning="groups of numbers that belong together"),
        "uncertain.draws": Whole(2, 10_000, default=40, meaning="draws per pilot of a robust search"),
        "uncertain.seed": Whole(0, 2**63 - 1, default=1, meaning="of the draws: draw i is the same for every pilot"),
    }


@dataclass(frozen=True)
class Objectives(Words):
    """A list of objectives, of which some may be quantiles: `quantile 5 % of gain_margin_db`."""

    def check(self, what: str, data: Any) -> tuple[str, ...]:
        """Return the objectives, quantiles spelled one way. StudyError for anything else."""
        if not isinstance(data, list | tuple):
            return super().check(what, data)
        key, equals, _ = what.rpartition(" = ")
        named = []
        for k, word in enumerate(data):
            if isinstance(word, str) and word.split()[:1] == ["quantile"]:
                try:
                    named.append(quantile(word).key)
                except ValueError as error:
                    raise StudyError(f"{f'{key}[{k}] = {shown(word)}' if equals else what} {error}") from None
            else:
                named.append(word)
        known = (*self.choices, *(word for word in named if isinstance(word, str) and word.startswith("quantile ")))
        return Words(tuple(dict.fromkeys(known))).check(what, named)


# ---- one distribution


def distribution(value: Value, number: Field) -> Distribution:
    """Return an entry of `uncertain.variables`, checked. Raises StudyError."""
    data = value.data
    if not isinstance(data, dict):
        raise value.error(
            f"is no distribution; a mapping such as {{distribution: normal, mean: 1, deviation: 0.1}} is wanted"
            f"{decimal_comma(data)}"
        )
    kind = data.get("distribution")
    if kind is None:
        raise value.missing("distribution")
    Choice(tuple(KEYS)).read(value.child("distribution"))
    known = ("distribution", *KEYS[kind], *(("within",) if kind in TRUNCATED else ()))
    known += ("as",) if kind != "words" else ()
    for key in data:
        if key == "within" and kind in KEYS:
            if kind not in TRUNCATED:
                raise value.child(key).error(f"is for {' and '.join(TRUNCATED)}; a {kind} distribution has ends")
        elif key not in known:
            raise StudyError(
                f"{value.child(key).place}{value.child(key).key}: key {key!r} is not known here; "
                f"{did_you_mean(key, known)}a {kind} distribution has {', '.join(known[1:])}"
            )
    missing = [key for key in KEYS[kind] if key not in data]
    if missing:
        raise value.missing(*missing)
    if (kind == "words") != isinstance(number, Choice):
        what = "a number; a distribution of numbers is" if kind == "words" else "a word; {distribution: words} is"
        raise value.error(f"is for {what} wanted")
    if kind == "words":
        return {"distribution": kind, "weights": _weights(value.child("weights"), number)}
    found: Distribution = {"distribution": kind}
    found |= {key: _number(value.child(key)) for key in KEYS[kind]}
    found["as"] = Choice((VALUE, FACTOR, OFFSET)).read(value.child("as")) if "as" in data else VALUE
    if "within" in data:
        found["within"] = _within(value.child("within"))
    problem = _no_support(found)
    if problem:
        raise value.error(problem)
    if found["as"] == VALUE and (problem := out_of_range(found, number, 0.0)):
        raise value.error(problem)
    return found


def _number(value: Value) -> float:
    data = value.data
    if isinstance(data, bool) or not isinstance(data, int | float) or not math.isfinite(data):
        raise value.error(f"is not a number{decimal_comma(data)}")
    return float(data)


def _within(value: Value) -> list[float]:
    if not isinstance(value.data, list) or len(value.data) != 2:
        raise value.error("must be a list of two numbers, [lowest, highest]")
    low, high = (_number(value.child(k)) for k in (0, 1))
    if not low < high:
        raise value.error("has its lower end not below its upper end")
    return [low, high]


def _weights(value: Value, number: Field) -> dict[str, float]:
    if not isinstance(value.data, dict) or not value.data:
        raise value.error("must be a mapping from words to shares, such as {position: 0.7, relax: 0.3}")
    found = {}
    for word in value.data:
        number.check(f"{value.child(word).place}{value.key}: {word!r}", word)
        share = _number(value.child(word))
        if share < 0.0:
            raise value.child(word).error("is a negative share")
        found[word] = share
    if abs(sum(found.values()) - 1.0) > 1e-9:
        raise value.error(f"adds up to {sum(found.values()):g}; shares of all words add up to 1")
    return found


def _no_support(one: Distribution) -> str:
    """What keeps a distribution from being one; empty if nothing does."""
    kind = one["distribution"]
    if kind == "normal" and not one["deviation"] > 0.0:
        return "has no spread: deviation must be greater than zero"
    if kind == "lognormal" and not (one["median"] > 0.0 and one["factor"] > 1.0):
        return (
            "is no log-normal distribution: median must be greater than zero, factor greater than 1 "
            "(two thirds lie between median / factor and median * factor)"
        )
    if kind == "uniform" and not one["lower"] < one["upper"]:
        return "has no support: lower must be below upper"
    if kind == "triangular" and not (one["lower"] <= one["mode"] <= one["upper"] and one["lower"] < one["upper"]):
        return "has no support: lower, mode and upper must rise"
    if "within" in one:
        inside = 1.0 - share_outside(one, *one["within"])
        if inside < RARE:
            return f"has no support: nothing of it lies within {shown(one['within'])}"
    return ""


def scale(one: Distribution) -> tuple[float, float]:
    """Mean and deviation of the normal score of what is drawn: of the logarithm for a log-normal one."""
    if one["distribution"] == "lognormal":
        return math.log(one["median"]), math.log(one["factor"])
    return one["mean"], one["deviation"]


def score(one: Distribution, x: float) -> float:
    """How many deviations above its mean a value of a normal or log-normal distribution lies."""
    mean, deviation = scale(one)
    if one["distribution"] == "lognormal":
        if x <= 0.0:
            return -math.inf
        x = math.log(x) if math.isfinite(x) else x
    return (x - mean) / deviation


def share_outside(one: Distribution, low: float, high: float) -> float:
    """Share of an untruncated normal or log-normal distribution outside an interval."""
    return _below(score(one, low)) + _below(-score(one, high))


def _below(z: float) -> float:
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def out_of_range(one: Distribution, number: Any, base: float) -> str:
    """What of a distribution lies where the number of a study cannot be; empty if next to nothing does.

    Parameters
    ----------
    one : mapping
        The distribution, of no words.
    number : Field
        What it is of, with `low` and `high`.
    base : float
        What the study says, that factors multiply and offsets are added to.
    """

    def value(x: float) -> float:
        return base * x if one["as"] == FACTOR else base + x if one["as"] == OFFSET else x

    unit = f" {number.unit}" if number.unit else ""
    allowed = f"{number.low:g} to {number.high:g}{unit}"
    ends = one.get("within") or ([one["lower"], one["upper"]] if "lower" in one else None)
    if ends is not None:
        low, high = sorted(value(x) for x in ends)
        if low < number.low or high > number.high:
            of = f" of {base:g}{unit}" if one["as"] != VALUE else ""
            return f"reaches from {low:g} to {high:g}{unit}{of}, outside {allowed}; narrow it"
        return ""
    outside = share_outside(one, *drawable(one, number, base))
    if outside > RARE:
        return f"lies outside {allowed} with a probability of {100 * outside:.3g} %; add within: [lowest, highest]"
    return ""


def drawable(one: Distribution, number: Any, base: float) -> tuple[float, float]:
    """Between which ends draws of a distribution give numbers that the study may have."""
    if one["as"] == OFFSET:
        return number.low - base, number.high - base
    if one["as"] == FACTOR:
        if base == 0.0:
            return -math.inf, math.inf
        low, high = sorted((number.low / base, number.high / base))
        return low, high
    return number.low, number.high


# ---- the section


def check_robust(section: Mapping[str, Any], objectives: Sequence[str]) -> None:
    """Raise Mistake if objectives are quantiles over draws that a study cannot have."""
    for one in quantiles(objectives):
        if not merged(section)[0]:
            raise Mistake("search.objectives", one.key, "needs a section uncertain, whose draws it is of; add one")
        rare = min(one.share, 1.0 - one.share)
        if rare * section["draws"] < 1.0 - 1e-9:
            raise Mistake(
                "search.objectives",
                one.key,
                f"is beyond {section['draws']} draws; give uncertain.draws: {math.ceil(1.0 / rare - 1e-9)} or more",
            )


def uncertain_from(data: str | Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the section complete; without sets and variables for a study that has none. Raises Mistake."""
    given: Mapping[str, Any] = {"sets": (data,)} if isinstance(data, str) else data or {}
    found = {"sets": (), "variables": None, "correlated": None, "draws": 40, "seed": 1, **given}
    if given and not found["sets"] and not found["variables"]:
        raise Mistake("uncertain", dict(given), f"says of nothing that it is uncertain; add sets ({', '.join(SETS)}) "
                      "or variables")  # fmt: skip
    return found


def merged(section: Mapping[str, Any]) -> tuple[dict[str, Distribution], list[dict[str, Any]], dict[str, str]]:
    """Return all distributions of a section, those of its sets included, its groups, and the set of each name.

    What `variables` says of a number takes the place of what a set says; so do groups of `correlated` with the same
    numbers.
    """
    variables: dict[str, Distribution] = {}
    groups: list[dict[str, Any]] = []
    origin: dict[str, str] = {}
    for name in section["sets"]:
        one = bundled_set(name)
        variables |= one["variables"]
        groups += one["correlated"]
        origin |= dict.fromkeys(one["variables"], name)
    for name, own in (section["variables"] or {}).items():
        variables[name] = own
        origin.pop(name, None)
    own_groups = list(section["correlated"] or ())
    taken = {name for group in own_groups for name in group["numbers"]}
    return variables, [group for group in groups if not taken & set(group["numbers"])] + own_groups, origin


def bundled_set(name: str) -> dict[str, Any]:
    """Return a set of pilotgen/data/uncertain.yaml: `variables`, `correlated`, `source`, `meaning`."""
    raw = bundled("uncertain").value[name]
    variables = {path: {"as": VALUE, **one} if "weights" not in one else dict(one)
                 for path, one in raw["variables"].items()}  # fmt: skip
    return {**raw, "variables": variables, "correlated": list(raw.get("correlated", ()))}


def matrix_of(group: Mapping[str, Any]) -> list[list[float]]:
    """Return the correlation matrix of a group, whose one number stands for all pairs."""
    given, size = group["correlation"], len(group["numbers"])
    if isinstance(given, Sequence):
        return [list(map(float, row)) for row in given]
    return [[1.0 if j == k else float(given) for k in range(size)] for j in range(size)]


def positive_definite(matrix: Sequence[Sequence[float]]) -> bool:
    """Whether a symmetric matrix has a Cholesky factor."""
    size = len(matrix)
    root = [[0.0] * size for _ in range(size)]
    for j in range(size):
        for k in range(j + 1):
            rest = matrix[j][k] - sum(root[j][i] * root[k][i] for i in range(k))
            if j == k:
                if rest <= 1e-12:
                    return False
                root[j][j] = math.sqrt(rest)
            else:
                root[j][k] = rest / root[k][k]
    return True
