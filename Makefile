# Every target builds what it needs from a fresh clone. PYTHON names the interpreter (3.11 or newer); all else lives in .venv.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
PYTEST := $(BIN)/python -m pytest

.PHONY: help demo test check slow bench schemas lint venv constraints clean
.NOTPARALLEL:

help:
	@echo "make demo    the main job, end to end: publish, filter, record, replay"
	@echo "make test    the tests (without the slow ones)"
	@echo "make check   the quick gate: format, lint, types, contract, tests"
	@echo "make slow    the slow tests: kills, stops and millions"
	@echo "make bench   programs that compare us with something else in the same run"
	@echo "make schemas writes schemas/ from the types: JSON Schemas and golden vectors"

demo: .venv/.run
	$(BIN)/tcbridge demo

test: .venv/.dev
	$(PYTEST) -n 2 -m "not slow"

# make check TESTED=1 leaves the tests out, for who has just run them with make test.
check: lint $(if $(TESTED),,test)

lint: .venv/.dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy bridge tests benches
	MYPYPATH=examples/tccom $(BIN)/mypy examples/*.py examples/tccom/*.py
	$(BIN)/lint-imports --no-cache --no-logo

slow: .venv/.slow
	$(PYTEST) -m slow --timeout 600

bench: .venv/.run
	@for program in benches/*.py; do echo "== $$program"; $(BIN)/python $$program || exit 1; done

# A test compares what is committed with what this writes.
schemas: .venv/.run
	$(BIN)/python schemas/generate.py

venv: .venv/.dev

# Take the newest versions that pyproject.toml allows, then write down what came.
constraints:
	rm -rf .venv/.renew && $(PYTHON) -m venv .venv/.renew
	.venv/.renew/bin/python -m pip --disable-pip-version-check --quiet install -e '.[dev]' hatchling
	.venv/.renew/bin/python -m pip --disable-pip-version-check --quiet install --no-deps pytmc
	( head -n 1 constraints.txt; .venv/.renew/bin/python -m pip --disable-pip-version-check freeze --exclude-editable | sort -f ) > .venv/.renew.txt
	mv .venv/.renew.txt constraints.txt && rm -rf .venv/.renew

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis

# .run has what the program needs, .dev what the tests need on top; .dev is .run too.
.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "tcbridge needs Python 3.11 or newer: make PYTHON=python3.11")'
	$(PYTHON) -m venv .venv

.venv/.run: pyproject.toml constraints.txt | .venv/bin/python
	$(PIP) install -e . -c constraints.txt
	@touch $@

.venv/.dev: pyproject.toml constraints.txt | .venv/bin/python
	$(PIP) install -e '.[dev]' -c constraints.txt
	@touch .venv/.run $@

# Real class files for one test: nothing of pytmc runs, so what it needs itself is left out.
.venv/.slow: .venv/.dev
	$(PIP) install --no-deps pytmc -c constraints.txt
	@touch $@
