"""Files in `results/` are of the release and the sources that are shipped, or are listed as what they are."""

import json
from dataclasses import replace

import pytest

from benchmarks import full
from benchmarks.common.documents import STAMP
from contract.errors import StillwakeError
from ecu.c.sources import sources_in

FIGURES, HISTORY = full.plan()


def test_every_file_has_one_place_in_the_plan_and_is_of_this_release_or_stated_to_be_old():
    names = [one.name for one in FIGURES]
    assert sorted([*names, *HISTORY]) == sorted(path.stem for path in full.RESULTS.glob("*.json"))
    for one in FIGURES:
        assert one.is_current() or one.old, f"{one.file}: python -m benchmarks full --only {one.name}"
        assert not (one.is_current() and one.old), f"{one.name} in full.toml: it is of this release now"


def test_no_other_file_names_another_release():
    """What a file states of itself, stamp or not."""
    for one in FIGURES:
        if full.RELEASE not in one.of or one.old:
            continue
        facts = json.loads(one.file.read_text(encoding="utf-8"))["facts"]
        named = facts.get("digest") or facts.get("bundle") or full.release()
        digest = named["digest"] if isinstance(named, dict) else named
        # A release that the command makes of the shipped model is another one.
        assert digest[:12] == full.release() or "export" in " ".join(one.before), one.file


def test_no_file_names_a_folder_of_the_machine():
    for path in full.RESULTS.glob("*.json"):
        assert '"/' not in path.read_text(encoding="utf-8"), path


def test_a_change_of_the_release_or_of_a_source_shows(monkeypatch: pytest.MonkeyPatch):
    (one,) = (figures for figures in FIGURES if figures.name == "mcu")
    before = one.stamp()["of"]
    assert set(before) == {*one.of} and len({*before.values()}) == len(one.of)
    of_loader = full.sources_hash("loader")
    sources = sources_in("loader")
    full.sources_hash.cache_clear()
    monkeypatch.setattr(full, "firmware_part", lambda folder: {**sources, "sw_more.c": b"int more;"})
    assert full.sources_hash("loader") != of_loader
    full.sources_hash.cache_clear()
    name, content = next((name, content) for name, content in sources.items() if name.endswith(".c"))
    monkeypatch.setattr(full, "firmware_part", lambda folder: {**sources, name: content + b"/* a\n comment */"})
    assert full.sources_hash("loader") == of_loader
    full.sources_hash.cache_clear()


def test_it_makes_stamps_goes_on_and_stops_at_what_fails(tmp_path, monkeypatch, capsys):
    write = tmp_path / "write.py"
    write.write_text('import sys\nopen(sys.argv[-1], \'w\').write(\'{"date": "", "figures": 1, "facts": {}}\')\n')
    good = full.Figures(name="good", run=f"python {write}", of=("release", "ecu"))
    bad = replace(good, name="bad", run="python -c 'import sys; sys.exit(3)'")
    missing = replace(good, name="missing", needs="no-such-program")
    monkeypatch.setattr(full, "RESULTS", tmp_path)
    monkeypatch.setattr(full, "plan", lambda: ([good, missing, bad], {}))
    for resume in (False, True):
        with pytest.raises(StillwakeError, match=r"bad: .* failed; .* --resume` continues here"):
            full.main(resume=resume)
        assert full.made(tmp_path / "good.json")["of"] == {"release": full.release(), "ecu": full.sources_hash("ecu")}
        out = capsys.readouterr().out
        assert "left out, because no-such-program is missing" in out and ("there already" in out) == resume
    # What only goes on keeps how long a whole one took.
    write.write_text(write.read_text().replace('"facts": {}', '"facts": {"runs": {"made": 1, "kept": 3}}'))
    (tmp_path / "good.json").write_text(json.dumps({"facts": {STAMP: {"minutes": 90.0}}}))
    full.main(only=["good"])
    assert full.made(tmp_path / "good.json")["minutes"] == 90.0
    with pytest.raises(StillwakeError, match="no such file"):
        full.main(only=["nothing"])
    full.main(show=True)
    assert "good" in capsys.readouterr().out
