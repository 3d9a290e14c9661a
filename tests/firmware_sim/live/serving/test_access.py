"""Who may look at the loop and act on it."""

from firmware_sim.live.serving.access import Access

HERE = Access(token=None)
FAR = Access(token="right")


def test_only_the_loopback_goes_without_a_token():
    assert [Access.to(address).token for address in ("127.0.0.1", "::1", "localhost", "127.8.0.1")] == [None] * 4
    tokens = [Access.to(address).token for address in ("0.0.0.0", "::", "192.168.0.7", "truck.example", "0.0.0.0")]
    assert len(set(tokens)) == 5
    # 128 random bits are 22 characters of base64.
    assert all(token is not None and len(token) >= 22 for token in tokens)


def test_this_machine_by_its_names():
    for host in ["localhost:8765", "127.0.0.1:8765", "[::1]:8765", "localhost", "LOCALHOST:1"]:
        assert HERE.refusal(host=host, origin=None, token=None) is None, host
        assert HERE.refusal(host=host, origin=f"http://{host}", token=None) is None, host


def test_a_name_that_was_pointed_here_is_refused():
    for host in ["evil.example:8765", "localhost.evil.example", "10.0.0.1", "", "[", "a@localhost@b"]:
        assert "localhost alone" in str(HERE.refusal(host=host, origin=f"http://{host}", token=None)), host


def test_a_page_of_another_server_is_refused():
    for access in [HERE, FAR]:
        for origin in [
            "http://evil.example",
            "http://localhost:3000",
            "null",
            "",
            "localhost:8765",
            "http://localhost:8765/x",
        ]:
            assert "another server" in str(access.refusal(host="localhost:8765", origin=origin, token="right")), access


def test_without_the_token_nothing():
    for token in [None, "", "wrong", "righ", "right ", "r\xefght"]:
        assert "the link" in str(FAR.refusal(host="truck.example:8765", origin=None, token=token)), token
        assert FAR.refusal(host="truck.example:8765", origin="http://truck.example:8765", token="right") is None, token
