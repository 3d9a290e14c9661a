"""`stillwake config` shows the settings that a call would have, and writes them as a file that gives them again; each
command takes the settings that it uses."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.config.listing import as_toml, sections, shown
from contract.config.loading import from_tree, leaves, load_config, to_tree
from contract.config.rules import HUGE, TINY
from contract.config.tree import Config
from contract.errors import ConfigError
from stillwake.console.settings import settings
from tests.examples import examples


def rows(text: str) -> dict[str, list[str]]:
    """The words of each setting's line, by its name."""
    lines = (line.split() for line in text.splitlines() if not line.startswith(" "))
    return {words[0]: words[1:] for words in lines if words and "." in words[0] and not words[0].startswith("[")}


def test_every_setting_is_shown_with_its_value_unit_and_source(printed, tmp_path):
    out = printed("config")
    values = dict(leaves(to_tree(load_config())))
    first = {name: words[0] for name, words in rows(out).items()}
    assert first == {name: shown(value) for name, value in values.items()}
    assert max(map(len, out.splitlines())) <= 80
    (tmp_path / "mine.toml").write_text("[ecu]\nhold_periods = 2\n")
    found = rows(printed("config", "--set", tmp_path / "mine.toml", "--set", "ecu.compute_time_ms=4.5"))
    for name, words in (
        ("ecu.hold_periods", ["2", "1", "periods", "file"]),
        ("ecu.compute_time_ms", ["4.5", "8", "ms", "--set"]),
        ("ecu.decay_periods", ["2", "periods", "default"]),
        ("mpc.weights.lift", ["0.04", "0.01", "release"]),
    ):
        assert found[name] == words
    paper = dict(leaves(to_tree(Config())))
    assert set(rows(printed("config", "--changed"))) == {name for name in values if values[name] != paper[name]}
    (tmp_path / "paper.toml").write_text('base = "paper"\n')
    assert printed("config", "--changed", "--set", tmp_path / "paper.toml") == "all settings: as in the paper\n"


def test_a_prefix_selects_and_explains(cli, refused):
    outcome = cli("config", "bus.e2e")
    assert set(rows(outcome.out)) == {"bus.e2e.max_delta", "bus.e2e.window", "bus.e2e.min_ok", "bus.e2e.max_errors"}
    assert "Must be at least 1. Number of latest check results that together decide" in outcome.out
    assert "Default (ours): AUTOSAR E2E leaves these numbers to the project" in outcome.out
    assert "Default (paper, section 2.4)." in cli("config", "mpc.horizon").out
    unknown = "error: no setting begins with 'nonsense'; the sections are operating_point, body"
    assert refused("config", "nonsense").startswith(unknown)


def test_the_file_it_writes_gives_the_same_settings(printed, refused, tmp_path):
    asked = ["--set", "model.slim_decoder_width=64", "--set", 'bus.channel=C:\\x "y" [z]', "--set", "mpc.horizon=9"]
    path = tmp_path / "mine.toml"
    for options in ([], ["--changed"]):
        path.write_text(printed("config", "--toml", *options, *asked), encoding="utf-8")
        assert load_config(path) == load_config(None, [word for word in asked if word != "--set"]), options
    path.write_text(printed("config", "ecu", "--toml", "--set", "ecu.delay_steps=3"), encoding="utf-8")
    assert load_config(path) == load_config(None, ["ecu.delay_steps=3"])
    assert set(tomllib.loads(path.read_text())) == {"ecu"}
    # A file of one section modifies the release's settings, so these would be the release's again.
    path.write_text('base = "paper"\n')
    for words, message in (
        (("model", "--toml", "--set", path), "model.slim_dynamics_width is none: a file of these settings alone"),
        (("mpc", "--toml", "--changed", "--set", "mpc.weights.lift=0.01"), "mpc.weights.lift is 0.01: a file"),
    ):
        assert message in refused("config", *words)


@examples(30)
@given(reynolds=st.floats(TINY, HUGE), channel=st.text(min_size=1), seed=st.integers(0, 2**31 - 1))
def test_any_number_and_text_is_read_back_as_it_was(reynolds, channel, seed):
    tree = {"flow": {"reynolds": reynolds}, "train": {"seed": seed}}
    if channel.strip() and channel.isprintable():
        tree["bus"] = {"channel": channel}
    config = from_tree(tree)
    read = tomllib.loads(as_toml(sections(config), base="paper"))
    assert read.pop("base") == "paper"
    assert from_tree(read) == config


def test_a_setting_that_would_have_no_effect_is_refused():
    with pytest.raises(ConfigError) as refused:
        settings("develop", ["flow.substeps=40", "mpc.horizon=9"], uses=["flow", "bus"])
    assert str(refused.value) == "--set mpc.horizon: `develop` does not use it; this command uses bus, flow"
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
    with pytest.raises(ConfigError, match=r"--set other\.toml is the second file"):
        settings("develop", [str(path), "other.toml"], uses=["flow"])
    assert capsys.readouterr().out == f"{path}: `develop` does not use mpc.horizon\n"
