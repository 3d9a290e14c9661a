"""Requests that are none, and numbers that JSON has not."""

import json

from firmware_sim.live.serving.control import as_json, check


def test_what_is_no_request_is_said():
    cases: list[tuple[str | bytes, str]] = [
        ("", "is JSON"),
        ("{", "is JSON"),
        ('{"set": {"noise": NaN}}', "NaN is no number"),
        ('{"set": {"noise": -Infinity}}', "-Infinity is no number"),
        ("[" * 5000, "is JSON"),
        ("9" * 5000, "is JSON"),
        (b"{}", "is text"),
        ("[]", "is an object"),
        ("null", "is an object"),
        ('{"id": "1"}', "id: must be"),
        ('{"id": true}', "id: must be"),
        ('{"id": 1.5}', "id: must be"),
    ]
    for text, says in cases:
        answer = check(text)
        assert answer is not None, text
        assert says in answer["error"], text
        assert "\n" not in answer["error"], text
    # Any other object is for the loop to judge.
    for text in ["{}", '{"id": 1, "set": {"enable": true}}', '{"id": -7, "anything": [1.5, null]}']:
        assert check(text) is None, text


def test_no_number_is_null():
    text = as_json({"a": float("nan"), "b": [float("inf"), 1.5]})  # type: ignore[arg-type]
    assert json.loads(text) == {"a": None, "b": [None, 1.5]}
