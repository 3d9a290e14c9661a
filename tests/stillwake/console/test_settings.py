"""A command takes the settings that it uses, and says so where it was given others."""

import pytest

from contract.errors import ConfigError
from stillwake.console.settings import settings


def test_a_setting_that_would_have_no_effect_is_refused():
    with pytest.raises(ConfigError) as refused:
        settings("develop", ["flow.substeps=40", "mpc.horizon=9"], uses=["flow", "bus"])
    assert str(refused.value) == "--set mpc.horizon: `develop` does not use it; it uses bus, flow"
    # A section whose name only begins alike is another.
    with pytest.raises(ConfigError, match=r"--set model\.window"):
        settings("x", ["model.window=3"], uses=["mod", "model.win"])
    for used in ("mpc", "mpc.weights", "mpc.weights.lift"):
        assert settings("export", ["mpc.weights.lift=0.5"], uses=[used]).config.mpc.weights.lift == 0.5


def test_a_file_may_serve_several_commands(tmp_path, capsys):
    path = tmp_path / "[mine].toml"
    path.write_text("[mpc]\nhorizon = 9\n[flow]\nsubsteps = 40\n")
    loaded = settings("develop", [str(path)], uses=["flow"])
    assert loaded.config.flow.substeps == 40
    with pytest.raises(ConfigError, match=r"--set other\.toml: is the second file"):
        settings("develop", [str(path), "other.toml"], uses=["flow"])
    assert capsys.readouterr().out == f"{path}: `develop` does not use mpc.horizon\n"
