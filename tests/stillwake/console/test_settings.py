"""A command takes the settings that it uses, and says so where it was given others."""

import pytest

from contract.config.loading import load_config
from contract.config.tree import Config
from contract.errors import ConfigError
from stillwake.console.settings import settings


def test_a_setting_that_would_have_no_effect_is_refused():
    with pytest.raises(ConfigError) as refused:
        settings("steady", None, ["flow.substeps=40", "mpc.horizon=9"], uses=["flow", "bus"])
    assert str(refused.value) == "--set mpc.horizon: `steady` does not use it; it uses bus, flow"


@pytest.mark.parametrize("used", [["mpc"], ["mpc.weights"], ["mpc.weights.lift"]])
def test_a_setting_of_a_used_section_is_taken(used):
    loaded = settings("export", None, ["mpc.weights.lift=0.5"], uses=used)
    assert loaded.config.mpc.weights.lift == 0.5
    assert loaded.given == {"mpc.weights.lift"}


def test_a_section_whose_name_only_begins_alike_is_another():
    with pytest.raises(ConfigError, match=r"--set model\.window"):
        settings("x", None, ["model.window=3"], uses=["mod", "model.win"])


def test_a_file_may_serve_several_commands(tmp_path, capsys):
    path = tmp_path / "[mine].toml"
    path.write_text("[mpc]\nhorizon = 9\n[flow]\nsubsteps = 40\n")
    loaded = settings("steady", path, [], uses=["flow"])
    assert loaded.config.flow.substeps == 40
    assert capsys.readouterr().out == f"{path}: `steady` does not use mpc.horizon\n"


def test_it_begins_with_the_releases_settings_or_with_others():
    assert settings("x", None, [], uses=[]).config == load_config()
    assert settings("x", None, [], uses=[], base=Config()).config == Config()
