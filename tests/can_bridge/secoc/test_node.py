import pytest

from can_bridge.secoc.key import write_key
from can_bridge.secoc.node import Authentication, authentication_in_virtual_time, key_of, secured
from can_bridge.secoc.securing import verify
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE_SECURED
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError, KeyFileError
from tests.can_bridge.secoc.conftest import SECRET


def test_one_setting_turns_it_on(tmp_path, genuine):
    assert authentication_in_virtual_time(BusConfig()) is None
    write_key(tmp_path / "key", SECRET)
    made = authentication_in_virtual_time(BusConfig(key=str(tmp_path / "key")))
    assert made is not None
    assert (made.trip, dict(made.heard)) == (1, {})
    assert verify(genuine(PRESSURE_SECURED).data, PRESSURE_SECURED, made.key) is not None
    assert [path.name for path in tmp_path.iterdir()] == ["key"]
    with pytest.raises(KeyFileError, match="No such file"):
        authentication_in_virtual_time(BusConfig(key=str(tmp_path / "none")))


def test_settings_and_key_must_agree(key):
    """A node that is to authenticate never goes on without."""
    authentication = Authentication(key=key)
    assert key_of(authentication, BusConfig(key="file")) is key
    assert key_of(None, BusConfig()) is None
    with pytest.raises(ConfigError, match=r"bus\.key = 'file': the node was made without a key"):
        key_of(None, BusConfig(key="file"))
    for plain in (BusConfig(), BusConfig(frames="classic")):
        with pytest.raises(ConfigError, match="the node was made with a key"):
            key_of(authentication, plain)


def test_without_a_key_a_frame_stays_as_it_is(key):
    frame = Frame(frame_id=JET_COMMAND.frame_id, data=bytes(8))
    authentication = Authentication(key=key)
    assert secured(frame, spec=JET_COMMAND, key=None, freshness=authentication.freshness) is frame
