# Everything a user or CI runs. `make compare` and `make test` set up by themselves.
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/python
# a file to a process, so that no two compile the same kernels or make the same fixture; tests/conftest.py has the order
PARALLEL := --numprocesses auto --dist loadfile --no-loadscope-reorder
INTERPRETED = $(shell grep -l "mark.interpreted" tests/test_*.py)
# of the library alone: what trains and draws has lower bounds of its own
LOWEST := $(addprefix tests/test_,algebra.py dynamics.py filters.py golden.py laws.py pilot.py profiles.py telemetry.py vector.py)
# Ray leaves threads in a process that has started it, so its tests and the other trainers' do not share one
REACH := .venv-reach/bin/python -m pytest --timeout 300 --numprocesses auto --dist loadfile
WITH_RAY := $(addprefix tests/test_reach_,examples.py ray.py rllib.py)
STAMP := $(VENV)/.installed

# as many processes as cores: threads of BLAS and torch besides, which wait by spinning, take four times as long
test test-slow test-basilisk test-reach test-lowest coverage mutation: export OMP_NUM_THREADS := 1

.PHONY: setup environments compare compare-all test test-slow test-basilisk test-reach test-lowest coverage mutation lint format train benchmark docs dist clean

setup: $(STAMP)

environments: setup .venv-basilisk/.installed .venv-reach/.installed  ## those of all lanes

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "satid-gym needs Python 3.11 or later; set PYTHON=...")'
	test -x $(RUN) || $(PYTHON) -m venv $(VENV)
	$(RUN) -m pip install --quiet --upgrade pip
	$(RUN) -m pip install --quiet --constraint constraints.txt --editable ".[train,dev,docs]"
	$(RUN) -m satid_gym.warmup
	touch $(STAMP)

compare: setup  ## the main job: learned, scripted and reactive policies on every satellite and inertia mode
	$(RUN) -m agents.compare

compare-all: setup  ## the standing table: every policy in every scenario (an hour or two; stopped, it goes on where it was)
	$(RUN) -m baselines.scenarios.tune
	$(RUN) -m agents.standing

test: setup  ## the quick lane: physics, filters, environment, statistics, documentation
	$(RUN) -m pytest $(PARALLEL) -m "not slow and not basilisk and not reach and (compiled or not interpreted)"
	NUMBA_DISABLE_JIT=1 $(RUN) -m pytest --numprocesses auto -m "interpreted and not compiled and not slow" $(INTERPRETED)

test-slow: setup  ## the long lane: kills, browser, training, harnesses, long statistics
	$(RUN) -m pytest $(PARALLEL) -m slow

test-basilisk: .venv-basilisk/.installed  ## truth and filter against Basilisk, an independent simulator, in .venv-basilisk (it caps versions of its own)
	.venv-basilisk/bin/python -m pytest --numprocesses auto --dist loadgroup tests/test_basilisk.py

.venv-basilisk/.installed: pyproject.toml constraints.txt
	test -x .venv-basilisk/bin/python || $(PYTHON) -m venv .venv-basilisk
	grep -E "^(numpy|scipy|numba|llvmlite|gymnasium|hypothesis|pytest|pytest-timeout|pytest-xdist|tyro)=" constraints.txt > .venv-basilisk/constraints.txt
	.venv-basilisk/bin/python -m pip install --quiet --constraint .venv-basilisk/constraints.txt --editable ".[basilisk]"
	touch $@

test-reach: .venv-reach/.installed  ## the examples for RLlib, Ray, TorchRL, Tianshou, skrl, RL Zoo and Minari, in .venv-reach (they cap versions of their own)
	if test -f .venv-reach/.installed; then $(REACH) $(WITH_RAY) && $(REACH) $(filter-out $(WITH_RAY),$(wildcard tests/test_reach_*.py)); fi

.venv-reach/.installed: pyproject.toml constraints.txt
	test -x .venv-reach/bin/python || $(PYTHON) -m venv .venv-reach
	grep -E "^(numpy|scipy|numba|llvmlite|torch|stable_baselines3|hypothesis|pytest|pytest-timeout|pytest-xdist|tyro)=" constraints.txt > .venv-reach/constraints.txt
	if .venv-reach/bin/python -m pip install --quiet --constraint .venv-reach/constraints.txt --editable ".[reach]" 2> .venv-reach/pip.log; then touch $@; \
	elif grep "No matching distribution" .venv-reach/pip.log; then echo "test-reach skipped: this registry lacks a package"; \
	else cat .venv-reach/pip.log; exit 1; fi

test-lowest:  ## the library with the oldest versions that pyproject.toml allows, in .venv-lowest (not in CI: they do not change)
	test -x .venv-lowest/bin/python || $(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/python -m pip install --quiet uv
	VIRTUAL_ENV=.venv-lowest .venv-lowest/bin/uv pip install --quiet --resolution lowest-direct --editable ".[telemetry]" "pytest>=8" "pytest-xdist>=3.6" "pytest-timeout>=2.3" "hypothesis>=6.100"
	NUMBA_CACHE_DIR=$(CURDIR)/.venv-lowest/compiled .venv-lowest/bin/python -m pytest --numprocesses auto --dist loadfile $(LOWEST)

coverage: setup  ## of satid_gym, by the tests that are quick without the compiler (some minutes)
	NUMBA_DISABLE_JIT=1 $(RUN) -m pytest --numprocesses auto --cov

mutation: setup  ## whether the tests notice what is wrong (a quarter of an hour; stopped, it goes on where it was)
	$(RUN) -m tests.qa.mutation

lint: setup
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

format: setup
	$(RUN) -m ruff check --fix .
	$(RUN) -m ruff format .

train: setup  ## the shipped policies again: the generalist's five runs, what combines them, and PPO
	for seed in 0 1 2 3 4; do $(RUN) -m agents.imitate --seed $$seed || exit 1; done
	$(RUN) -m agents.training.combine runs/generalist-0 runs/generalist-1 runs/generalist-2 runs/generalist-3 runs/generalist-4 --seed 1
	$(RUN) -m agents.train --settings ppo --seed 0

benchmark: setup
	$(RUN) -m satid_gym.benchmark

docs: setup  ## the documentation site, in build/site
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build
	@echo "build/site/index.html"

dist: setup  ## wheel and sdist in dist/, built twice with the same bytes, the wheel used by itself
	$(RUN) -m tests.qa.distribution

clean:
	rm -rf $(VENV) .venv-basilisk .venv-reach .venv-lowest build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
