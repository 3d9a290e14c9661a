"""Who may look at the loop and act on it."""

import pytest

from firmware_sim.live.serving.access import Access

HERE = Access(token=None)
FAR = Access(token="right")


def test_only_the_loopback_goes_without_a_token():
    assert [Access.to(address).token for address in ("127.0.0.1", "::1", "localhost", "127.8.0.1")] == [None] * 4
    tokens = [Access.to(address).token for address in ("0.0.0.0", "::", "192.168.0.7", "truck.example", "0.0.0.0")]
    assert len(set(tokens)) == 5
    # 128 random bits are 22 characters of base64.
    assert all(token is not None and len(token) >= 22 for token in tokens)


@pytest.mark.parametrize("host", ["localhost:8765", "127.0.0.1:8765", "[::1]:8765", "localhost", "LOCALHOST:1"])
def test_this_machine_by_its_names(host):
    assert HERE.refusal(host=host, origin=None, token=None) is None
    assert HERE.refusal(host=host, origin=f"http://{host}", token=None) is None


@pytest.mark.parametrize("host", ["evil.example:8765", "localhost.evil.example", "10.0.0.1", "", "[", "a@localhost@b"])
def test_a_name_that_was_pointed_here_is_refused(host):
    assert "localhost alone" in str(HERE.refusal(host=host, origin=f"http://{host}", token=None))


@pytest.mark.parametrize("access", [HERE, FAR])
@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://localhost:3000", "null", "", "localhost:8765", "http://localhost:8765/x"]
)
def test_a_page_of_another_server_is_refused(access, origin):
    assert "another server" in str(access.refusal(host="localhost:8765", origin=origin, token="right"))


@pytest.mark.parametrize("token", [None, "", "wrong", "righ", "right ", "r\xefght"])
def test_without_the_token_nothing(token):
    assert "the link" in str(FAR.refusal(host="truck.example:8765", origin=None, token=token))
    assert FAR.refusal(host="truck.example:8765", origin="http://truck.example:8765", token="right") is None
