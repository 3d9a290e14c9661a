# `make demo` closes the loop, `make test` checks everything; both set up .venv by themselves.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: demo test lint retrain full tables clean

demo: $(VENV)/run.stamp
	$(BIN)/stillwake run runs/demo

test: lint
	$(BIN)/python -m pytest -n 2

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# From the shipped recording to a bundle of the shipped kind, then the loop with it.
retrain: $(VENV)/dev.stamp
	$(BIN)/stillwake train runs/model
	$(BIN)/stillwake export runs/model runs/bundle
	$(BIN)/stillwake run runs/retrained --bundle runs/bundle

# Everything slow: the tests left out of `make test`, and the figures in results/ that docs/results.md shows.
full: test
	$(BIN)/python -m pytest -m full
	$(BIN)/stillwake run runs/demo --json results/demo.json
	$(BIN)/python benchmarks/controller.py --json results/controller.json
	$(MAKE) tables

tables: $(VENV)/dev.stamp
	$(BIN)/python benchmarks/tables.py

$(VENV)/run.stamp: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable ".[sim]"
	touch $@

$(VENV)/dev.stamp: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable ".[dev]"
	touch $@ $(VENV)/run.stamp

clean:
	rm -rf $(VENV) runs build .mypy_cache .ruff_cache .pytest_cache .hypothesis
