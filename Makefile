# Two commands are enough: `make demo` and `make test`. Both make their own .venv.
# `make help` lists the rest.

SHELL  := /bin/bash
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
LOWEST := $(VENV)/lowest
PIP    := $(BIN)/python -m pip --disable-pip-version-check

# pytest: three workers on two cores, since campaigns and browsers keep a worker waiting; who is done
# takes over tests that another has still to do.
PYTEST_FLAGS ?= -n 3 --dist worksteal
export MPLBACKEND := Agg
# What the shell has on its path is not in another's clone: with it mypy sees other types.
unexport PYTHONPATH
# Tests start hundreds of processes: without byte code each compiles the package and its tests again.
test quick long lowest cold fuzz attack mutants: export PYTHONDONTWRITEBYTECODE :=
# One thread each, so that workers do not fight over the cores: those of OpenBLAS turn while they
# wait, a sixth of the time of a fit.
test quick long lowest fuzz attack: export NUMBA_NUM_THREADS := 1
test quick long lowest fuzz attack: export OMP_NUM_THREADS := 1
test quick long lowest fuzz attack: export OPENBLAS_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help demo paper paper-quick test quick long lowest cold check lint types layers workflows speed docs newcomer format fuzz attack mutants clean install install-dev python-is-new-enough

help: ## show this list
	@grep -hE '^[a-z-]+:.*## ' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

demo: $(VENV)/.installed ## simulate the paper's experiment, calibrate, reconstruct, write out/demo/
	@$(BIN)/lightflight demo -o out/demo

paper: $(VENV)/.installed ## the paper's experiments, figures and table in out/paper/; ARGS="fig6 --fresh"
	@$(BIN)/python -m studies.zheng2020 $(ARGS)

paper-quick: $(VENV)/.installed ## the same with few angles and recordings
	@$(BIN)/python -m studies.zheng2020 --quick $(ARGS)

test: $(VENV)/.installed-dev ## run the whole test suite
	@$(BIN)/python -m pytest $(PYTEST_FLAGS)

quick: $(VENV)/.installed-dev ## the suite without its slow tests
	@$(BIN)/python -m pytest $(PYTEST_FLAGS) -m "not slow and not long"

long: $(VENV)/.installed-dev ## further cases of slow tests, which the suite leaves out
	@$(BIN)/python -m pytest $(PYTEST_FLAGS) -m long

cold: $(VENV)/.installed-dev ## what the first run of each command compiles, and how long it takes
	@NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/cold_start.py --quick

# Numba keeps one version's kernels beside the source: these go elsewhere. Of paths that a recording
# gives the short one is enough here, and random files are not read twice.
lowest: $(VENV)/.installed-lowest ## contract and format tests with the lowest versions allowed
	@NUMBA_CACHE_DIR=$(CURDIR)/$(LOWEST)/numba $(LOWEST)/bin/python -m pytest $(PYTEST_FLAGS) \
	  -p no:cacheprovider tests/contracts tests/formats tests/batch/test_table.py \
	  -k "not (same_path and (joint or photon))" --ignore tests/formats/test_fuzz.py \
	  --ignore tests/contracts/test_mutants.py --ignore tests/contracts/test_deciding.py \
	  --ignore tests/contracts/test_house.py --ignore tests/contracts/test_ways_in.py \
	  tests/attacks/test_zarr.py tests/attacks/test_tls.py tests/attacks/test_packing.py

check: lint types layers workflows ## ruff, mypy, import-linter, zizmor

lint: $(VENV)/.installed-dev ## ruff: rules and format
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev ## mypy, strict
	@$(BIN)/mypy

layers: $(VENV)/.installed-dev ## import-linter: nothing imports upward
	@$(BIN)/lint-imports

workflows: $(VENV)/.installed-dev ## zizmor: .github, which is never run here, and the hooks of pre-commit
	@$(BIN)/zizmor --offline --quiet --strict-collection --persona=pedantic .
	@$(BIN)/pre-commit validate-config

speed: $(VENV)/.installed-dev ## asv: a few speeds of this checkout as ratios, kept in .asv
	@$(BIN)/asv machine --yes >/dev/null
	@$(BIN)/asv run --environment existing:$(BIN)/python --set-commit-hash "$$(git rev-parse HEAD)"

docs: $(VENV)/.installed-docs ## the pages under docs/ as HTML in out/docs; warnings are errors
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs out/docs
	@echo "docs: out/docs/index.html" >&2

newcomer: $(VENV)/.installed-dev ## type what README, tutorial and how-tos print into empty folders: out/newcomer.log
	@$(BIN)/python tools/newcomer.py -o out/newcomer.log

format: $(VENV)/.installed-dev ## let ruff order and format the code
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

fuzz: $(VENV)/.installed-dev ## new random input at length: property tests, 20,000 damaged files
	@HYPOTHESIS_PROFILE=fuzz $(BIN)/python -m pytest $(PYTEST_FLAGS) -m hypothesis --timeout=3600
	@$(BIN)/python -m tests.fuzz_readers --files 20000 --keep out/fuzz

attack: $(VENV)/.installed-dev ## tests/attacks at length: more mutants, more kills
	@LIGHTFLIGHT_ATTACK=long $(BIN)/python -m pytest $(PYTEST_FLAGS) --timeout=7200 -m "" tests/attacks

mutants: $(VENV)/.installed-dev ## mistakes put into copies of the package: does a test notice each? ARGS="verdict lap"
	@$(BIN)/python tools/mutants.py $(ARGS)

clean: ## remove the environment, results and caches
	@rm -rf $(VENV) out build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	@rm -rf docs/reference/generated docs/gallery
	@find src studies tests benchmarks tools -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

install: $(VENV)/.installed ## the environment alone, as `make demo` needs it
install-dev: $(VENV)/.installed-dev ## the environment with everything that tests and checks need

MAKE_VENV := test -x $(BIN)/python || { echo "making $(VENV) ..." >&2; $(PYTHON) -m venv $(VENV); } || \
  { rm -rf $(VENV); echo "make: $(PYTHON) cannot make a virtual environment: install its venv module (Debian: apt install python3-venv)" >&2; exit 1; }
DEV := --editable ".[readers,camera,view,batch,docs]" --group dev

# The stamps depend on pyproject.toml alone: the package is installed editable.
$(VENV)/.installed: pyproject.toml | python-is-new-enough
	@$(MAKE_VENV)
	@echo "installing lightflight into $(VENV) (once; a minute or two) ..." >&2
	@$(PIP) install --quiet --upgrade "pip>=25.1"
	@$(PIP) install --quiet --editable .
	@touch $@

# uv installs it all in a tenth of pip's time. Where it reaches no index (certificates or mirrors that
# only pip was told of), pip does.
$(VENV)/.installed-dev: pyproject.toml | python-is-new-enough
	@$(MAKE_VENV)
	@echo "installing lightflight and what its tests need into $(VENV) ..." >&2
	@$(PIP) install --quiet "uv>=0.9"
	@$(BIN)/uv pip install --quiet --python $(BIN)/python $(DEV) || { \
	  echo "uv could not: pip tries ..." >&2; \
	  $(PIP) install --quiet --upgrade "pip>=25.1" && $(PIP) install --quiet $(DEV); }
	@touch $(VENV)/.installed $(VENV)/.installed-docs $@

$(VENV)/.installed-docs: pyproject.toml | $(VENV)/.installed
	@echo "installing what the docs need into $(VENV) ..." >&2
	@$(PIP) install --quiet --upgrade "pip>=25.1"
	@$(PIP) install --quiet --editable ".[docs]"
	@touch $@

$(VENV)/.installed-lowest: pyproject.toml | $(VENV)/.installed-dev
	@echo "installing the lowest versions allowed into $(LOWEST) ..." >&2
	@rm -rf $(LOWEST)
	@$(BIN)/uv venv --quiet --python $(BIN)/python $(LOWEST)
	@$(BIN)/uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct \
	  --editable ".[readers,camera,view,batch]" --group test
	@touch $@

python-is-new-enough:
	@test -x $(BIN)/python || command -v $(PYTHON) >/dev/null || \
	  { echo "make: $(PYTHON) is not installed; lightflight needs Python 3.11 or newer (or: make PYTHON=/path/to/python3.12)" >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "make: $(PYTHON) is $$($(PYTHON) -V 2>&1); lightflight needs Python 3.11 or newer (or: make PYTHON=/path/to/python3.12)" >&2; exit 1; }
