from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.config.loading import from_tree, load, load_config, to_tree
from contract.config.tree import Config
from contract.errors import ConfigError
from tests.examples import examples


def test_file_goes_on_top_of_the_releases_settings_or_of_the_papers(tmp_path):
    """One from Windows; the overrides go on top of it."""
    (tmp_path / "mine.toml").write_bytes(b"\xef\xbb\xbf[mpc]\r\niterations = 3\r\n[mpc.weights]\r\nlift = 1\r\n")
    release, mine = load_config(), load(tmp_path / "mine.toml", ["mpc.weights.lift = 2"])
    assert mine.config.mpc == replace(release.mpc, iterations=3, weights=replace(release.mpc.weights, lift=2.0))
    assert isinstance(mine.config.mpc.weights.lift, float)
    assert mine.config.train == release.train != Config().train
    assert mine.in_file == frozenset({"mpc.iterations", "mpc.weights.lift"})
    assert mine.in_overrides == frozenset({"mpc.weights.lift"})
    (tmp_path / "paper.toml").write_text('base = "paper"\n')
    assert load_config(tmp_path / "paper.toml") == Config()
    (tmp_path / "mine.toml").write_text("[mpc]\nhorizon = 9\n[mpc.weights]\nlift = 1\ndrag_mean = 2\n")
    weights = load_config(tmp_path / "mine.toml").mpc.weights
    assert tuple(vars(weights).values()) == weights.as_tuple()


def test_a_bad_override_is_refused_in_one_short_line_with_its_value_and_what_is_right():
    cases = {
        "mpc.horizont=3": "mpc has no 'horizont': did you mean horizon?",
        "mcp.horizon=3": "there is no section 'mcp'; the sections are mpc, ",
        "ecu.horizon=3": "ecu has no 'horizon': did you mean mpc.horizon?",
        "mpc.weights=3": "mpc.weights is a section: write mpc.weights.key=value",
        "mpc.horizon": "section.key=value",
        "mpc.horizon=1 2": "'1 2' is not a TOML value",
        "mpc.horizon=2.5": "mpc.horizon = 2.5: must be a whole number",
        "train.schedule=cosine": "train.schedule = 'cosine': must be 'constant' or 'one_cycle'",
        "flow.reynolds=nan": "flow.reynolds = nan: must be positive",
        "flow.substeps=" + "9" * 400: "flow.substeps = a number of more than 18 digits: must be in 1..10000",
        "ecu.hold_periods=9223372036854775807": "must be at most 2147483647 in size",
        "flow.substeps=" + "9" * 9999: "override 'flow.substeps=999",
        "flow.substeps=" + "[" * 5000: "is not a TOML value",
        "bus.channel=\udcff": "holds a character that cannot be printed",
    }
    for override, line in cases.items():
        with pytest.raises(ConfigError) as refused:
            load_config(None, [override])
        text = str(refused.value)
        assert line in text and len(text) < 250 and text.isprintable(), (override, text)


def test_a_setting_that_is_gone_is_read_where_it_changed_nothing(tmp_path):
    (tmp_path / "old.toml").write_text("[refine]\niterations = false\nunits = 3\n")
    assert load(tmp_path / "old.toml").in_file == {"refine.units"}
    tree = to_tree(Config())
    assert from_tree({**tree, "refine": {**tree["refine"], "iterations": False}}) == Config()
    for value in (True, "x"):
        with pytest.raises(ConfigError, match=f"^refine.iterations = '?{value}'?: this version has no such setting"):
            from_tree({**tree, "refine": {**tree["refine"], "iterations": value}})


def test_text_needs_no_quotation_marks():
    for channel in ("239.74.163.2", "/dev/ttyUSB0", "can0", "0", "2026-01-01", "a b", "C:\\x", "true", "[x]", "#1"):
        assert load_config(None, [f"bus.channel={channel}"]).bus.channel == channel
        assert load_config(None, [f"bus.channel='{channel}'"]).bus.channel == channel


@examples(40)
@given(st.text())
def test_any_override_gives_settings_or_one_line(text):
    for override in (text, f"bus.channel={text}", f"flow.reynolds={text}", f"{text}=1", f"ecu.{text}=1"):
        try:
            load_config(None, [override])
        except ConfigError as error:
            assert len(str(error).splitlines()) == 1


def test_a_bad_file_is_refused_with_its_name(tmp_path):
    path = tmp_path / "bad.toml"
    for text, line in (
        (b"[mpc\n", "Expected"),
        (b"\xff\xfe", "is not UTF-8 text"),
        (b"x = " + b"[" * 5000, "recursion"),
        (b"#" * 2**20 + b"\n", "larger than 1048576 bytes"),
        (b'base = "thesis"\n', "base = 'thesis': must be 'paper' or 'release'"),
    ):
        path.write_bytes(text)
        with pytest.raises(ConfigError, match=r"^configuration .*bad\.toml: ") as refused:
            load_config(path)
        assert line in str(refused.value), text[:20]
    with pytest.raises(ConfigError, match=r"nowhere\.toml: No such file"):
        load_config(tmp_path / "nowhere.toml")
