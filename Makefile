# Every target sets up what it needs: a virtual environment in .venv, no root.
PYTHON ?= $(firstword $(foreach v,3.11 3.12 3.13,$(shell command -v python$(v) 2>/dev/null)) python3)
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
MISSION ?= configs/missions/demo/mission.yaml
OUT ?= runs/demo

.DEFAULT_GOAL := help
.PHONY: help setup run test test-all bench lint docs site simulate train thermal-pool clean

help: ## print the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY) ## make .venv with the exact versions of requirements.lock

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' || \
		{ echo "error: $(PYTHON) is not Python 3.11 to 3.13; name one: make PYTHON=/path/to/python3.12 (Debian: apt install python3)" >&2; exit 2; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || \
		{ echo "error: $(PYTHON) cannot make virtual environments (Debian: apt install python3-venv)" >&2; exit 2; }
	@echo "setting up $(VENV)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@$(BIN)/python -m actors.system_check
	@touch $@

run: setup ## the demo: video and telemetry of two drones in, map of people out (runs/demo)
	$(BIN)/searchlight run $(MISSION) --out $(OUT)

test: setup ## the tests (about ten minutes), in two processes; those that start a Ray one after the other
	$(BIN)/python -m pytest -n 2 --dist loadscope --no-loadscope-reorder --durations 60

test-all: setup ## the tests and the slow sweeps, or a part of them: make test-all PART=3/12 (results in runs/tests; what passed is not run again)
	$(BIN)/python -m pytest -p tests.parts -m "" --part $(or $(PART),1/1)

bench: setup ## every figure of the README, measured here
	$(BIN)/python -m tests.benchmarks.figures

lint: setup ## ruff, mypy, import-linter
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: setup ## docs/mission-file.md from the schema
	$(BIN)/python -m pipeline.config.reference docs/mission-file.md

site: setup ## the documentation as a site that needs no internet (runs/site)
	$(BIN)/python -m mkdocs build --strict

simulate: setup ## render the demo's mission again
	$(BIN)/searchlight simulate configs/scenarios/demo.yaml --out runs/mission-demo

train: setup ## train the shipped detectors again (about an hour and a half on two idle cores)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[train]'
	for name in nano small medium large; do \
		$(BIN)/searchlight train configs/detectors/$$name.train.yaml --out runs/train || exit; done

thermal-pool: setup ## configs/pools/thermal.yaml from the held-out flights of ../shared/data/thermal
	$(BIN)/searchlight evaluate configs/evaluations/thermal.yaml --out runs/thermal-evaluation
	rm -f configs/pools/thermal.yaml
	$(BIN)/searchlight pool merge runs/thermal-evaluation/pool.yaml --out configs/pools/thermal.yaml

clean: ## remove .venv and runs
	rm -rf $(VENV) runs
