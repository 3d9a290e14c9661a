"""The command around a campaign: the plan it lists, what it refuses, how it ends."""

import json

import pytest

from tests.firmware_sim.campaign.conftest import Worker

OWN = """
[[group]]
title = "Mine"
[[group.scenario]]
name = "mine"
sentence = "Something of my own."
disturb = ["noise:level=0.3"]
"""

pytestmark = pytest.mark.usefixtures("no_pictures")


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(OWN)
    return path


@pytest.fixture
def executor(monkeypatch) -> Worker:
    return Worker(monkeypatch)


@pytest.mark.slow  # a second of CPU or more
def test_the_plan_is_listed_and_nothing_is_run(printed, executor, plan, tmp_path) -> None:
    out = printed("campaign", "--list", "--scenarios", plan)
    assert "  undisturbed: " in out
    assert "  mine: Something of my own.\n      noise:level=0.3\n" in out
    # Times in the texts are of the run: control is requested after the window of 64 periods and two more.
    assert "dead:sensor=base_0@3.32.." in out
    few = printed("campaign", tmp_path / "out", "--list", "--only", "delay_1*")
    assert "noise" not in few
    assert "delay_12_uncompensated" in few
    assert executor.ran == []
    assert [path.name for path in tmp_path.iterdir()] == ["plan.toml"]


@pytest.mark.slow  # draws pages
def test_a_campaign_writes_page_table_figures_and_results(printed, executor, plan, tmp_path) -> None:
    folder, file = tmp_path / "out", tmp_path / "out" / "figures.json"
    call = ("campaign", folder, "--scenarios", plan, "--only", "mine", "--phases", 2, "--json", file)
    found = "2 of 2 scenarios safe; under disturbance 1 useful, 0 marginal, 0 of no use."
    assert printed(*call).rstrip().splitlines()[-2] == found
    assert {path.name for path in folder.iterdir()} >= {"report.html", "table.csv", "figures", "runs", "starts"}
    result = json.loads(file.read_text())
    assert [row["name"] for row in result["figures"]] == ["undisturbed", "mine"]
    row = result["figures"][1]
    assert (row["safe"], row["use"], row["phases"]) == (True, "useful", 2)
    assert (row["reduction_percent"], row["abs_Cl"]) == (pytest.approx(20.0), 0.2)
    assert (result["facts"]["seed"], result["facts"]["controlled"]) == (0, 60.0)
    executor.ran.clear()
    assert "0 runs computed, 6 read from the folder" in printed(*call)
    assert executor.ran == []


@pytest.mark.slow  # draws pages
def test_one_broken_invariant_is_status_3(cli, executor, tmp_path) -> None:
    executor.unsafe = "gust"
    outcome = cli("campaign", tmp_path / "out", "--only", "gust", "--phases", 1, "--controlled", 40)
    assert outcome.code == 3
    assert "1 of 2 scenarios safe" in outcome.out
    assert "gust: phase 0: period 3: jets_shut" in outcome.out


def test_a_stopped_campaign_says_how_to_go_on_and_no_other_continues_it(cli, refused, executor, tmp_path) -> None:
    executor.stop_after = 2
    call = ("campaign", tmp_path / "out", "--only", "gust", "--phases", 1, "--controlled", 40)
    outcome = cli(*call)
    assert outcome.code == 130
    assert outcome.err == f"stopped; {tmp_path / 'out'} holds 2 finished runs; the same command continues\n"
    assert "other seed; give another folder" in refused(*call, "--seed", 1)
    executor.ran.clear()
    executor.stop_after = 0
    nothing = cli("campaign", tmp_path / "other", "--only", "gust", "--phases", 1, "--controlled", 40)
    assert (nothing.code, nothing.err) == (130, "stopped\n")
    assert not (tmp_path / "other").exists()


def test_a_call_that_cannot_be_is_one_line(all_refused, executor) -> None:
    rows = {
        "": "name the folder",
        "out --only noize*": "noize",
        "out --settle 60": "--settle 60",
        "out --json out/campaign.json": "--json out/campaign.json: this command reads or writes another file",
        "out --workers many": "--workers many: must be a number of processes, or an address",
        "out --set train.epochs=3": "train.epochs",
        "out --set flow.control_period=0.3": "control period",
    }
    all_refused("campaign", rows)
    assert executor.ran == []
