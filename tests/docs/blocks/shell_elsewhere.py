"""The lines that other tests run, and those that no test can.

Flashing, calibration, the fleet, the C folder and the signature are run line by line there. The other tests run the
same command with arguments of their own, because the line as it stands takes minutes, two processes or real time;
`tests/docs/test_pages.py` sees that the line's options exist.
"""

from typing import Final

from tests.docs.blocks.plan import MULTICAST, Cannot, Elsewhere

_FLASH_PAGES: Final = "tests/stillwake/test_flash_pages.py::"
_FOLDER: Final = "tests/export/to_c/test_folder.py::"

ELSEWHERE: Final = (
    *(
        Elsewhere(
            form=form,
            test=f"{_FLASH_PAGES}test_the_tour_flashes_and_calibrates_and_so_does_the_page_of_calibration",
        )
        for form in (
            r"stillwake ecu --slots slots --access access\.key --set bus\.interface=udp_multicast .*",
            rf"stillwake (flash|calibrate|ecu info) .*{MULTICAST}.*",
            r"stillwake calibrate --bus socketcan:can0.*",
        )
    ),
    *(
        Elsewhere(
            form=form,
            test=f"{_FLASH_PAGES}test_the_page_of_flashing_leads_from_the_first_key_to_the_revocation_of_one",
        )
        for form in (
            r"stillwake ecu --slots slots --access access\.key --set bus\.interface=socketcan .*",
            r"stillwake flash (firmware_sim/data/bundle|runs/mine|runs/mine_2) --bus socketcan:can0 .*",
            r"stillwake flash-keys .*",
        )
    ),
    Elsewhere(
        form=rf"stillwake (ecu|vehicle) --set bus\.interface=udp_multicast --set bus\.channel={MULTICAST}.*",
        test="tests/stillwake/commands/test_vehicle.py::test_an_ecu_and_its_vehicle_on_one_bus",
    ),
    Elsewhere(
        form=r"stillwake bench latency .*",
        test="tests/stillwake/commands/bench/test_latency.py::test_a_short_run_on_a_real_bus",
    ),
    Elsewhere(
        form=r"stillwake bench serve.*",
        test="tests/stillwake/commands/bench/test_serve.py::test_it_serves_a_loop_and_ends_both_processes",
    ),
    Elsewhere(
        form=r"stillwake campaign runs/(?!mine).*",
        test="tests/stillwake/commands/test_campaign.py::test_a_campaign_writes_page_table_figures_and_results",
    ),
    Elsewhere(
        form=r"stillwake tune .*",
        test="tests/stillwake/commands/test_tune.py::test_a_search_ends_with_table_verdict_command_and_files",
    ),
    Elsewhere(
        form=r"stillwake record (data|my)\.h5 --under .*|stillwake record linear\.h5 .*",
        test="tests/stillwake/test_command_line.py::test_rounds_under_a_controller_are_added",
    ),
    Elsewhere(
        form=r"stillwake record data\.h5 --from-steady .*",
        test="tests/stillwake/commands/test_record_from_steady.py::test_a_steady_wake_that_is_not_there_is_computed_and_kept",
    ),
    Elsewhere(
        form=r"stillwake steady .*",
        test="tests/stillwake/commands/test_plant.py::test_steady_writes_state_and_figures",
    ),
    Elsewhere(
        form=r"stillwake (export|run|mcu) runs/(linear|with_linear).*",
        test="tests/stillwake/commands/test_identify.py::test_bundle_and_library_drive_the_loop",
    ),
    Elsewhere(
        form=r"stillwake identify .*",
        test="tests/stillwake/commands/test_identify.py::test_a_model_is_identified_and_described",
    ),
    Elsewhere(
        form=r"stillwake export runs/mine runs/mine_bundle .*",
        test="tests/export/release/test_own_plant.py::test_a_bundle_of_another_plant_runs_on_that_plant_and_on_no_other",
    ),
    Elsewhere(
        form=r"stillwake run \S+ --ecu (c|cortex-m7).*",
        test="tests/firmware_sim/bench/test_ecus.py::test_the_command_runs_each_and_says_so",
    ),
    Elsewhere(
        form=r"python my_selection\.py .*",
        test="tests/docs/test_extending.py::test_its_script_prints_names_that_train_takes",
    ),
    Elsewhere(form=r"python -m benchmarks", test="tests/benchmarks/test_door.py::test_the_list_names_all"),
    Elsewhere(
        form=r"python examples/fleet/(repository|vehicle)\.py .*",
        test="tests/test_fleet_example.py::test_the_lines_of_the_page_do_the_same",
    ),
    Elsewhere(
        form=r"(python as_csv\.py|stillwake dataset import foreign\.h5) .*",
        test="tests/test_examples.py::test_a_recording_as_csv_is_what_another_solver_would_give",
    ),
    Elsewhere(
        form=r"cd runs/controller_c|cc -std=c99 .*|\./replay .*",
        test=f"{_FOLDER}test_the_readmes_line_builds_an_example_that_answers_as_expected",
    ),
    Elsewhere(form=r"cmake .*|ctest .*", test=f"{_FOLDER}test_cmake_builds_it_and_its_test_passes"),
    Elsewhere(
        form=r"tail -n 1 manifest\.sig .*|openssl pkeyutl .*",
        test="tests/test_shipped_artefacts.py::test_openssl_agrees_about_the_signature",
    ),
)

CANNOT: Final = (
    Cannot(form=r"(dask|OMP_NUM_THREADS=1|while|address=).*|.*--scheduler tcp://.*", why="needs a cluster"),
    Cannot(form=r"set -eu", why="the shell's own"),
    Cannot(form=r"make .*", why="sets up an environment, and each target calls what other lines call"),
    Cannot(form=r"pip install .*|\. \.venv/bin/activate", why="an environment of the reader's, from a package index"),
    Cannot(form=r"sudo .*|printf .* \| sudo .*|journalctl .*", why="needs root, and systemd"),
    Cannot(form=r"ssh .*", why="needs another computer"),
    Cannot(form=r"(cantools monitor|python -m can\.(logger|player)) .*socketcan.*", why="needs a CAN interface"),
    Cannot(form=r"cantools decode .*", why="another project's command"),
    Cannot(form=r"python -m tests\.fuzz .*", why="needs atheris, which no install here has"),
    Cannot(form=r"(python -m )?pytest .*", why="tests of this suite"),
    Cannot(form=r"python -m benchmarks NAME --help|.*=\.\.\.|.*\b(BUNDLE|FOLDER)\b.*", why="has a place for a name"),
    Cannot(
        form=r"python -m (benchmarks|tests\.proofs\.\w+) .*",
        why="minutes to hours; test_pages.py looks at the name and options of benchmarks",
    ),
    Cannot(form=r".*--plant openfoam.*", why="needs icoFoam, and hours"),
    Cannot(form=r"stillwake record \S+ --paper .*", why="hours, and the shipped recording is its result"),
    Cannot(form=r"stillwake flash new\.zip .*", why="what a fleet's server sent goes to the reader's ECU"),
    Cannot(
        form=r"cd examples/square_cylinder|stillwake .*(square|start\.npz|foreign).*",
        why="half an hour; `python -m benchmarks square` goes the same way",
    ),
)
"""Looked at first: an exception among them is an exception."""
