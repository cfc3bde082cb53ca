# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# What a user installs, and what tests, types, style and documentation need beside it
PRODUCT := $(VENV)/.product
STAMP := $(VENV)/.installed
DEMO := demo
LOCKED := 3.11 3.12 3.13
VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
# Every package in the version with which the tests passed, for each version of Python; `make lock` renews them.
LOCK := $(wildcard constraints/python-$(VERSION).txt)
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check $(if $(LOCK),--constraint $(LOCK))
# Idle threads of linear algebra within a worker of the tests would only compete.
PYTESTFLAGS :=
PYTEST := OMP_NUM_THREADS=1 $(BIN)/pytest --dist worksteal $(PYTESTFLAGS)
REALTIME = $(shell grep -rl --include=test_*.py mark.realtime tests)
COMPILED := $(BIN)/uv pip compile --quiet pyproject.toml --no-header --no-annotate --no-emit-index-url --no-emit-find-links
LOWEST := .venv-lowest
EXTRAS := http tables pdf cluster

.PHONY: help install demo test test-extended test-kernel test-long test-lowest test-cost lock bench docs dist gallery \
  lint types laws compiled first clean

help:
	@echo "make install    the virtual environment in $(VENV)"
	@echo "make demo       the paper's experiments and two tensile tests on a virtual rig; report in $(DEMO)/report.html"
	@echo "make test       lint, types, import laws and the tests of every module, in minutes"
	@echo "make test-extended  whole matrices, damaged files, packaging, programs by others, pages: the second part of CI"
	@echo "make test-kernel  the camera drivers on a real kernel and a real GigE Vision peer, with their figures"
	@echo "make test-long  campaigns of many minutes"
	@echo "make test-lowest  the tests with the lowest version of each dependency that pyproject.toml admits"
	@echo "make test-cost  processor time by test, fixture and file"
	@echo "make lock       the locked versions in constraints/, from what is newest"
	@echo "make bench      speed of correlation and of whole jobs beside other engines, accuracy against theory, the recorder"
	@echo "make docs       the documentation site in docs/_build/html; a warning is an error"
	@echo "make dist       the source distribution in dist/, from which packaging/conda/recipe.yaml builds"
	@echo "make gallery    every picture of the documentation, drawn anew"

install: $(STAMP)

$(PRODUCT): pyproject.toml $(LOCK)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "offaxis needs Python 3.11 or newer; $(PYTHON) is older. Name another: make PYTHON=python3.12 install" >&2; exit 2; }
	@test -n "$(LOCK)" || echo "Python $(VERSION): no locked versions in constraints/, so the newest packages are installed" >&2
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable .
	@touch $@

$(STAMP): $(PRODUCT)
	$(PIP) --editable '.[test]'
	@touch $@

demo: $(PRODUCT)
	$(BIN)/rig demo --output $(DEMO)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

laws: $(STAMP)
	$(BIN)/lint-imports

compiled: $(STAMP)
	$(BIN)/python -m tests.compile_kernel
# Finding the tests once keeps their bytecode, which each worker would otherwise compile.
	@$(BIN)/pytest --collect-only -q -m "not long" >/dev/null

# The tests start many programs. Each compiles every module anew where the environment forbids bytecode files.
test first test-extended test-long test-cost: export PYTHONDONTWRITEBYTECODE =

test: $(STAMP)
	$(MAKE) --no-print-directory -j 2 compiled lint laws
# The type checker needs one processor for half a minute, and prints its verdict among the first tests.
	$(MAKE) --no-print-directory -j 2 types first
# One after the other: a test beside them would take the processor time that they need. Few files have such tests.
	$(PYTEST) -m "realtime and not extended and not long" $(REALTIME)

# Three workers keep two processors busy while some tests wait. With four, answers of simulated devices come late.
first: $(STAMP)
	$(PYTEST) -n 3 -m "not extended and not long and not realtime"

test-extended: $(STAMP)
	$(PYTEST) -n 3 -m "extended and not long and not realtime"
	$(PYTEST) -m "extended and realtime and not long" $(REALTIME)

test-cost: $(STAMP) compiled
	$(PYTEST) -n 2 -p tests.cost --cost-file test-cost.csv -m "not long and not realtime"

test-kernel: $(STAMP)
	$(BIN)/pytest -rA tests/real_cameras/kernel_vm tests/real_cameras/gige

test-long: $(STAMP)
	$(PYTEST) -n 2 -m "long and not realtime"
	$(PYTEST) -m "long and realtime" $(REALTIME)

# Peers and tools of the tests are not the lowest: only what a user installs is.
test-lowest: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(PYTHON) -m venv $(LOWEST)
	$(COMPILED) --resolution lowest-direct --python-version $(VERSION) --output-file $(LOWEST)/constraints.txt \
	  $(foreach extra,$(EXTRAS),--extra $(extra))
	$(LOWEST)/bin/python -m pip install --quiet --constraint $(LOWEST)/constraints.txt --editable '.[suite]'
# What an old version uses of a newer one may be deprecated: that is a matter of versions to come.
	OMP_NUM_THREADS=1 $(LOWEST)/bin/pytest -n 2 --dist worksteal -W ignore::DeprecationWarning -m "not long and not realtime"

lock: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	mkdir -p constraints
	for version in $(LOCKED); do \
	  $(COMPILED) --upgrade --extra test --python-version $$version --output-file constraints/python-$$version.txt || exit; \
	done

bench: $(STAMP)
	$(BIN)/python -m benchmarks.speed --peers
	$(BIN)/python -m benchmarks.whole_job --peers
	$(BIN)/python -m benchmarks.accuracy
# Idle threads of linear algebra would count as processor time of the settings.
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.choice
	$(BIN)/python -m benchmarks.recorder

docs: $(STAMP)
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html

dist: $(STAMP)
	$(BIN)/python -c 'from setuptools import build_meta; print(build_meta.build_sdist("dist"))' | tail -n 1

gallery: $(STAMP)
	$(BIN)/python docs/pictures.py

clean:
	rm -rf $(VENV) $(LOWEST) $(DEMO) build dist docs/_build *.egg-info test-cost.csv .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
