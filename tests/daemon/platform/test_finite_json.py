"""What is written as JSON is JSON: infinity and NaN are null, wherever they stand."""

from __future__ import annotations

import json
import math

import pytest

from daemon.platform.finite_json import to_json


@pytest.mark.parametrize("endless", [math.inf, -math.inf, math.nan])
def test_what_is_no_number_or_has_no_end_is_null(endless: float) -> None:
    said = to_json({"a": endless, "b": [1.5, (endless,)], "c": {"d": endless}, "e": None, "f": "NaN", "g": True})
    assert json.loads(said) == {"a": None, "b": [1.5, [None]], "c": {"d": None}, "e": None, "f": "NaN", "g": True}
    assert to_json(endless) == "null"


def test_a_key_without_an_end_goes_by_its_name() -> None:
    assert json.loads(to_json({math.inf: 1, 2.5: 2, "a": {math.nan: 3}})) == {"inf": 1, "2.5": 2, "a": {"nan": 3}}
