"""`stillwake run` and `report`: what is refused, what the exit status says, and what is on disk afterwards."""

import json
import shutil
from dataclasses import replace

import pytest
import typer

from can_bridge.wire.messages import Mode, Reason
from contract.config.controller import CostWeights
from contract.config.loading import load
from contract.errors import ConfigError
from contract.release import bundle, signing
from firmware_sim.runs import run_log
from firmware_sim.runs.run_log import RunFolder
from stillwake.commands.run import exit_with
from stillwake.parts.releases import asked_calibration
from tests.conftest import SIGNING_KEY
from tests.firmware_sim.runs.conftest import shedding_log

pytestmark = pytest.mark.usefixtures("no_pictures")
QUICK = ["--lead-in", 1.2, "--controlled", 1.0, "--no-averages"]  # long enough for a window of four rows


BEFORE = {
    # Numbers that are none, and spans too short for averages.
    "--settle 200 --controlled 2": "--controlled = 2 less --settle = 200 leaves -198 t_c: must be at least 10",
    "--no-averages --require-reduction 20": "--require-reduction needs averages",
    "--require-reduction nan": "--require-reduction nan: must be a number of percent",
    "--require-reduction 0.2": "--require-reduction 0.2: must be in percent; for 20 % write 20",
    "--drive steady-55": "drive 'steady-55': must be a file ending in .csv, or one of steady-60, ",
    # An ECU in C.
    "--json out/series.npz": "--json out/series.npz: this command reads or writes another file there",
    "--state s.mcap --frames s.mcap": "s.mcap is the same path as s.mcap, or lies in it",
    "--ecu rust": "--ecu rust: must be one of python, c, mcu, or a clock in MHz as in mcu@300",
    "--ecu c@3": "--ecu c@3: must be one of python, c, mcu",
    "--ecu mcu@fast": "--ecu mcu@fast: 'fast' must be a clock in MHz",
    "--ecu c --set bus.key=k.pem": "k.pem: cannot read the key",
    "--ecu c --library nowhere": "library nowhere: No such file or directory",
    # What the bundle fixes, and what a run does not use.
    "--set mpc.iterations=50": "mpc.iterations = 50: this setting is fixed to 5 in the bundle; make another",
    "--set train.epochs=3": "--set train.epochs: `run` does not use it",
    "--set openfoam.refinement=0.5": "--set openfoam.refinement: `run` does not use it",
}
QUICK_ONES = {
    "--set bus.interface=socketcan": "bus.interface = 'socketcan': a run is in virtual time",
    "--set vehicle.actuator_delay=1000": "vehicle.actuator_delay = 1000: control is requested for 5 pe",
    "--set bus.nominal_bitrate=100": "raise bus.nominal_bitrate or bus.data_bitrate",
    # A start of another Reynolds number, with a command that works.
    "--set flow.reynolds=400": "the shipped start has 500; `stillwake develop start_re400.npz --set flow.reynolds="
    "400` makes a state for `--state start_re400.npz --set flow.reynolds=400`",
    "--state nowhere.npz": "nowhere.npz is not a flow state",
    # Faults on the bus.
    "--disturb ecu:disconnect:kind=device_gone": "use `ecu:disconnect` for an open wire",
}


@pytest.mark.slow  # many calls
def test_what_cannot_be_run_is_one_line(all_refused, short_release):
    all_refused(("run", "out", "--bundle", short_release), BEFORE)
    all_refused(("run", "out", "--bundle", short_release, *QUICK), QUICK_ONES)


def test_given_weights_take_the_place_of_the_bundles_and_other_settings_must_be_its_own(random_release, tmp_path):
    release = bundle.load(random_release)
    ours, path = release.manifest.mpc, tmp_path / "settings.toml"
    # The release's settings have other weights than this bundle: they are not what the user gave.
    assert load().config.mpc.weights != ours.weights
    assert asked_calibration(load(), release).weights == ours.weights
    found = asked_calibration(load(None, ["mpc.weights.lift=9.0", "mpc.weights.effort=0.5"]), release)
    assert found.weights == replace(ours.weights, lift=9.0, effort=0.5)
    path.write_text(f"[mpc]\nhorizon = {ours.horizon}\n[mpc.weights]\nlift = 3\n")
    assert asked_calibration(load(path), release).weights.lift == 3.0
    path.write_text("[mpc]\nhorizon = 7\n")
    with pytest.raises(ConfigError, match=r"mpc\.horizon = 7: this setting is fixed to 8 in the bundle; .*horizon=7`"):
        asked_calibration(load(path), release)


@pytest.mark.slow
def test_weights_in_force_are_kept_with_the_run_which_is_reported_again(cli, printed, tmp_path, short_release, coarse):
    folder, signed_short = tmp_path / "run", shutil.copytree(short_release, tmp_path / "signed")
    bundle.sign(signed_short, SIGNING_KEY)
    call = ("run", folder, "--bundle", signed_short, *QUICK, *coarse.words)
    out = printed(*call, "--set", "mpc.weights.lift=9", "--json", tmp_path / "run.json")
    signer = signing.public_key(SIGNING_KEY).fingerprint
    assert out.count("warning: ") == 1
    assert f"warning: signed by key {signer}, unknown here" in out
    assert "No averages were requested" in out
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["signer"], summary["weights_changed"], summary["weights"]["lift"]) == (signer, ["lift"], 9.0)
    assert summary["mpc"]["weights"]["lift"] == CostWeights().lift
    assert summary["bundle"]["digest"] == bundle.load(signed_short).digest
    page = (folder / "report.html").read_text()
    assert "not the bundle&#39;s: lift 9 (bundle 0.01)" in page
    assert f"signed by key {signer[:12]}" in page
    facts = json.loads((tmp_path / "run.json").read_text())["facts"]
    assert facts["config"]["mpc"]["weights"]["lift"] == 9.0
    assert summary["started_with"]["command"][:2] == ["stillwake", "run"]
    before = (folder / "series.npz").read_bytes()
    assert "holds a run: give another folder, or --overwrite to replace it" in cli(*call).err
    assert (folder / "series.npz").read_bytes() == before
    (folder / "report.html").unlink()
    printed("report", folder)
    assert (folder / "report.html").read_text() == page


def test_what_cannot_be_reported_is_refused(all_refused, tmp_path):
    (tmp_path / "a").mkdir()
    rows = {
        "a b": "to compare 2 runs, name the page to write: --output FILE.html",
        "a b --output x.pdf": "--output x.pdf: must be one .html file",
        "a b --output x.html --output x.csv": "--output x.csv: must be one .html file",
        "a b --output x.html": "a/series.npz: not the series of a run",
        "a a/../a --output x.html": "given twice",
        "a b c d e f g --output x.html": "7 runs cannot be compared on a page; give between 2 and 6 runs",
        "a --output a/vorticity_controlled.png": "is one of the run's own pictures; give another name",
        "a --output x.xyz": "--output x.xyz: must end in .html, .csv, .png, .pdf, .svg, .mf4, .mcap",
        "a.log": "a.log is a log: give one log, and --output FILE.mf4",
        "a.log --output x.html": "x.html: a measurement must end in .mf4 or .mcap",
        "c.h5 --output x.csv": "c.h5 is a data set: give one data set and one --output FILE.nc",
    }
    all_refused("report", rows)


@pytest.mark.slow
def test_a_drive_of_a_file_lasts_as_long_as_the_file(printed, tmp_path, short_release, coarse):
    (tmp_path / "mine.csv").write_text("t_s,speed_m_per_s\n0,30\n0.3,25\n")
    words = ("--drive", tmp_path / "mine.csv", "--lead-in", 1.2, "--no-averages", *coarse.words)
    printed("run", tmp_path / "run", "--bundle", short_release, *words)
    log = run_log.load(RunFolder(tmp_path / "run").series)
    # 0.3 s is 15 periods, and of 12 time steps for 25 m/s it takes 15 for 30.
    assert (len(log.series["t"]), log.enabled_at, log.metadata.config.flow.substeps) == (21, 6, 15)
    assert log.series["speed"][[0, 6, 20]] == pytest.approx([30.0, 30.0, 30.0 - 5.0 * 14 / 15])
    assert log.metadata.drive == "mine.csv"


@pytest.mark.slow
def test_a_run_with_faults_on_the_bus_is_known_as_one(cli, tmp_path, short_release, coarse):
    faults = ("vehicle:disconnect@0.14..", "ecu:duplicate")
    words = [word for one in faults for word in ("--disturb", one)] + [*coarse.words]
    outcome = cli("run", tmp_path / "r\udcff", "--bundle", short_release, *QUICK, *words, "--seed", 7)
    assert (outcome.code, outcome.err) == (3, "")
    headline = f"Disturbed ({'; '.join(faults)})."
    assert headline in " ".join(outcome.out.split())
    found = json.loads((tmp_path / "r\udcff" / "summary.json").read_text())
    assert headline in found["headline"]
    # An open wire loses what the vehicle sends, pressures and speed, and what it would have received, in the last four
    # of eleven periods: a command and a status each, twice.
    assert found["injected_faults"] == [{"text": faults[0], "acted": 8 + 16}, {"text": faults[1], "acted": 22}]
    assert found["fault_seed"] == 7
    page = (tmp_path / "r\udcff" / "report.html").read_text()
    assert headline in page and 'role="alert">ECU FAULT: ' in page


def test_a_reduction_that_is_not_reached_ends_with_status_4(run_metadata, capsys):
    log = shedding_log(run_metadata)
    exit_with(log, 19.9)
    with pytest.raises(typer.Exit) as ended:
        exit_with(log, 20.1)
    assert ended.value.exit_code == 4
    assert "--require-reduction 20.1: not reached, the reduction is 20.00 %" in capsys.readouterr().out
    with pytest.raises(typer.Exit) as ended:
        exit_with(shedding_log(run_metadata, modes={3: Mode.FAULT}, reasons={3: Reason.DEADLINE}), None)
    assert ended.value.exit_code == 3
