# Everything runs in .venv, which `make` builds with the first Python that is new enough.
PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11; do \
	"$$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$python && break; done)
VENV := .venv
BIN := $(VENV)/bin
# Python compiles a module when it is first used. To compile all at once costs half as much time again, and 0.2 GB.
# Where the environment forbids to keep what was compiled, each process would compile for four seconds.
unexport PYTHONDONTWRITEBYTECODE
PIP := $(BIN)/python -m pip install --quiet --no-compile
# The default install alone, and what working on flightcal needs besides.
INSTALLED := $(VENV)/installed
INSTALLED_DEV := $(VENV)/installed-dev
RUN ?= runs/leo_observer

.PHONY: demo test test-slow attack bench lint format kernels chromium clean

demo: $(INSTALLED)
	$(BIN)/flightcal demo --out $(RUN)

test: $(INSTALLED_DEV)
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not slow"

test-slow: $(INSTALLED_DEV)
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m slow

# Kills, interruptions, damaged files and full disks; prints its tables. Takes half an hour.
attack: $(INSTALLED_DEV)
	$(BIN)/python -m benchmarks.attack

# Side by side with peers, which it installs; writes docs/benchmarks.md. Takes half an hour.
bench: $(INSTALLED_DEV)
	$(PIP) --editable ".[bench]"
	$(BIN)/python -m benchmarks

lint: $(INSTALLED_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(INSTALLED_DEV)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Tests compile what is missing; this does most of it with both cores.
kernels: $(INSTALLED)
	PYTHONPATH=src $(BIN)/python tests/kernels.py

# The report's browser tests are skipped without it, and that of its print without poppler-utils.
chromium:
	command -v chromium pdftotext >/dev/null || \
		(apt-get update && apt-get install --yes --no-install-recommends chromium poppler-utils)

$(INSTALLED): pyproject.toml
	@test -n "$(PYTHON)" || { echo "flightcal needs Python 3.11 or newer with venv: none of python3, python3.11 to python3.13 is; name one with make PYTHON=..."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(PIP) --upgrade pip
	$(PIP) --editable .
	@touch $@

$(INSTALLED_DEV): $(INSTALLED)
	$(PIP) --editable ".[dev]"
	@touch $@

clean:
	rm -rf $(VENV) build dist src/*.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
