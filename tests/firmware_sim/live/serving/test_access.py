"""Who may look at the loop and act on it, and which requests are none."""

import json

from firmware_sim.live.serving.handlers import PageAccess, as_json, check

HERE = PageAccess(token=None)
FAR = PageAccess(token="right")


def test_only_the_loopback_goes_without_a_token():
    assert [PageAccess.to(address).token for address in ("127.0.0.1", "::1", "localhost", "127.8.0.1")] == [None] * 4
    tokens = [PageAccess.to(address).token for address in ("0.0.0.0", "::", "192.168.0.7", "truck.example", "0.0.0.0")]
    assert len(set(tokens)) == 5
    # 128 random bits are 22 characters of base64.
    assert all(token is not None and len(token) >= 22 for token in tokens)


def test_others_are_refused_by_their_host_origin_or_token():
    for host in ("localhost:8765", "127.0.0.1:8765", "[::1]:8765", "localhost", "LOCALHOST:1"):
        assert HERE.refusal(host=host, origin=None, token=None) is None, host
        assert HERE.refusal(host=host, origin=f"http://{host}", token=None) is None, host
    # A name that was pointed here.
    for host in ("evil.example:8765", "localhost.evil.example", "10.0.0.1", "", "[", "a@localhost@b"):
        assert "only to localhost" in str(HERE.refusal(host=host, origin=f"http://{host}", token=None)), host
    origins = ("http://evil.example", "http://localhost:3000", "null", "", "localhost:8765", "http://localhost:8765/x")
    for access in (HERE, FAR):
        for origin in origins:
            refusal = access.refusal(host="localhost:8765", origin=origin, token="right")
            assert "another server" in str(refusal), (access, origin)
    for token in (None, "", "wrong", "righ", "right ", "r\xefght"):
        assert "the link" in str(FAR.refusal(host="truck.example:8765", origin=None, token=token)), token
    assert FAR.refusal(host="truck.example:8765", origin="http://truck.example:8765", token="right") is None


def test_what_is_no_request_gets_an_error():
    cases: dict[str, tuple[str | bytes, ...]] = {
        "must be JSON": ("", "{", "[" * 5000, "9" * 5000),
        "NaN is not a number": ('{"set": {"noise": NaN}}',),
        "-Infinity is not a number": ('{"set": {"noise": -Infinity}}',),
        "must be text": (b"{}",),
        "must be an object": ("[]", "null"),
        "id: must be": ('{"id": "1"}', '{"id": true}', '{"id": 1.5}'),
    }
    for message, texts in cases.items():
        for text in texts:
            error = (check(text) or {})["error"]
            assert message in error and "\n" not in error, text
    # Any other object is for the loop to judge.
    for text in ["{}", '{"id": 1, "set": {"enable": true}}', '{"id": -7, "anything": [1.5, null]}']:
        assert check(text) is None, text


def test_no_number_is_null():
    assert json.loads(as_json({"a": float("nan"), "b": [float("inf"), 1.5]})) == {"a": None, "b": [None, 1.5]}
