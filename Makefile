# Two commands are enough: `make demo` and `make test`. Both make their own .venv.
# `make help` lists the rest.

SHELL  := /bin/bash
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check

# pytest: two workers; one Numba thread each, so that they do not fight over the cores
PYTEST_FLAGS ?= -n 2
export MPLBACKEND := Agg

.DEFAULT_GOAL := help
.PHONY: help demo test quick check lint types layers docs format fuzz clean install install-dev python-is-new-enough

help: ## show this list
	@grep -hE '^[a-z-]+:.*## ' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

demo: $(VENV)/.installed ## simulate the paper's experiment, calibrate, reconstruct, write out/demo/
	@$(BIN)/lightflight demo -o out/demo

test: $(VENV)/.installed-dev ## run the whole test suite
	@NUMBA_NUM_THREADS=1 $(BIN)/python -m pytest $(PYTEST_FLAGS)

quick: $(VENV)/.installed-dev ## the suite without its slow tests
	@NUMBA_NUM_THREADS=1 $(BIN)/python -m pytest $(PYTEST_FLAGS) -m "not slow"

check: lint types layers ## ruff, mypy, import-linter

lint: $(VENV)/.installed-dev ## ruff: rules and format
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev ## mypy, strict
	@$(BIN)/mypy

layers: $(VENV)/.installed-dev ## import-linter: nothing imports upward
	@$(BIN)/lint-imports

docs: $(VENV)/.installed-docs ## the pages under docs/ as HTML in out/docs; warnings are errors
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs out/docs
	@echo "docs: out/docs/index.html" >&2

format: $(VENV)/.installed-dev ## let ruff order and format the code
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

fuzz: $(VENV)/.installed-dev ## new random input at length: property tests, 20,000 damaged files
	@HYPOTHESIS_PROFILE=fuzz NUMBA_NUM_THREADS=1 $(BIN)/python -m pytest $(PYTEST_FLAGS) -m hypothesis --timeout=3600
	@NUMBA_NUM_THREADS=1 $(BIN)/python -m tests.fuzz_readers --files 20000 --keep out/fuzz

clean: ## remove the environment, results and caches
	@rm -rf $(VENV) out build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	@rm -rf docs/reference/generated
	@find src tests benchmarks tools -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

install: $(VENV)/.installed ## the environment alone, as `make demo` needs it
install-dev: $(VENV)/.installed-dev ## the environment with everything that tests and checks need

# The stamps depend on pyproject.toml alone: the package is installed editable.
$(VENV)/.installed: pyproject.toml | python-is-new-enough
	@test -x $(BIN)/python || { echo "making $(VENV) ..." >&2; $(PYTHON) -m venv $(VENV); } || \
	  { rm -rf $(VENV); echo "make: $(PYTHON) cannot make a virtual environment: install its venv module (Debian: apt install python3-venv)" >&2; exit 1; }
	@echo "installing lightflight into $(VENV) (once; a minute or two) ..." >&2
	@$(PIP) install --quiet --upgrade "pip>=25.1"
	@$(PIP) install --quiet --editable .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(VENV)/.installed
	@echo "installing what the tests need into $(VENV) ..." >&2
	@$(PIP) install --quiet --upgrade "pip>=25.1"
	@$(PIP) install --quiet --editable ".[readers,camera,view,batch]" --group dev
	@touch $@

$(VENV)/.installed-docs: pyproject.toml | $(VENV)/.installed
	@echo "installing what the docs need into $(VENV) ..." >&2
	@$(PIP) install --quiet --upgrade "pip>=25.1"
	@$(PIP) install --quiet --editable ".[docs]"
	@touch $@

python-is-new-enough:
	@test -x $(BIN)/python || command -v $(PYTHON) >/dev/null || \
	  { echo "make: $(PYTHON) is not installed; lightflight needs Python 3.11 or newer (or: make PYTHON=/path/to/python3.12)" >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "make: $(PYTHON) is $$($(PYTHON) -V 2>&1); lightflight needs Python 3.11 or newer (or: make PYTHON=/path/to/python3.12)" >&2; exit 1; }
