# Every target sets up .venv by itself, from the hash-pinned requirements.lock; offline once that is done.
SHELL := /bin/bash
PYTHON ?= python3.11 python3 python3.12 python3.13
DEMO ?= experiments.demo
BENCH ?= experiments.benchmark
DEMO_ARGS ?=
BENCH_ARGS ?=
TEST_ARGS ?=
BIN := .venv/bin
INSTALLED := .venv/.installed

.PHONY: help demo test lint bench clean
.DEFAULT_GOAL := help

help:
	@echo "make demo    the overtaking study and highway-env, about 4 minutes; ends with the path of a report"
	@echo "make test    the test suite (TEST_ARGS='--slow' for all of it)"
	@echo "make lint    formatting, lint rules, types, dependency rules between the rooms"
	@echo "make bench   milliseconds per step, vehicle-steps per second, compile time"
	@echo "make clean   remove caches and build leftovers (not .venv, not outputs/)"

demo: $(INSTALLED)
	@$(BIN)/python -m $(DEMO) $(DEMO_ARGS)

test: $(INSTALLED)
	@$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(TEST_ARGS)

lint: $(INSTALLED)
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/pyright
	@$(BIN)/lint-imports --no-logo

bench: $(INSTALLED)
	@$(BIN)/python -m $(BENCH) $(BENCH_ARGS)

clean:
	@rm -rf build dist *.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache .benchmarks
	@find urbanjax experiments tests -name __pycache__ -type d -prune -exec rm -rf {} +

$(INSTALLED): requirements.lock pyproject.toml
	@if [ ! -x $(BIN)/python ]; then \
	  found=; for candidate in $(PYTHON); do \
	    if $$candidate -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then found=$$candidate; break; fi; \
	  done; \
	  if [ -z "$$found" ]; then \
	    echo "urbanjax needs Python 3.11 or newer and found none (tried: $(PYTHON)). Try: make PYTHON=/path/to/python3.11" >&2; \
	    exit 1; \
	  fi; \
	  echo "Creating .venv with $$($$found --version)"; \
	  $$found -m venv .venv || { rm -rf .venv; exit 1; }; \
	fi
	@echo "Installing $$(grep -c '==' requirements.lock) pinned packages into .venv (once; a few minutes)"
	@$(BIN)/python -m pip install --disable-pip-version-check --require-hashes -r requirements.lock
	@$(BIN)/python -m pip install --disable-pip-version-check --quiet --no-deps --no-build-isolation -e .
	@touch $@
