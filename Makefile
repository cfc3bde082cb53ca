# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO := demo

.PHONY: help install demo test test-kernel test-long bench docs gallery lint types laws compiled clean

help:
	@echo "make install    the virtual environment in $(VENV)"
	@echo "make demo       the paper's experiments and a tensile test on a virtual rig; report in $(DEMO)/report.html"
	@echo "make test       lint, types, import laws and the whole suite"
	@echo "make test-kernel  the camera drivers on a real kernel and a real GigE Vision peer, with their figures"
	@echo "make test-long  campaigns of many minutes"
	@echo "make bench      speed of correlation beside other engines, accuracy against theory, speed of the recorder"
	@echo "make docs       the documentation site in docs/_build/html; a warning is an error"
	@echo "make gallery    every picture of the documentation, drawn anew"

install: $(STAMP)

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "offaxis needs Python 3.11 or newer; $(PYTHON) is older. Name another: make PYTHON=python3.12 install" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	@touch $@

demo: $(STAMP)
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

# The tests start hundreds of programs. Each compiles every module anew where the environment forbids bytecode files.
test test-long: export PYTHONDONTWRITEBYTECODE =

test: $(STAMP)
	$(MAKE) --no-print-directory -j 2 types compiled lint laws
# Four workers keep two processors busy while some tests wait; threads within a worker would only compete.
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 4 --dist worksteal -m "not long and not realtime"
	$(BIN)/pytest -n 2 --dist worksteal -m "realtime and not long"

test-kernel: $(STAMP)
	$(BIN)/pytest -rA tests/real_cameras/kernel_vm tests/real_cameras/gige

test-long: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal -m "long and not realtime"
	$(BIN)/pytest -m "long and realtime"

bench: $(STAMP)
	$(BIN)/python -m benchmarks.speed --peers
	$(BIN)/python -m benchmarks.accuracy
# Idle threads of linear algebra would count as processor time of the settings.
	OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.choice
	$(BIN)/python -m benchmarks.recorder

docs: $(STAMP)
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html

gallery: $(STAMP)
	$(BIN)/python docs/pictures.py

clean:
	rm -rf $(VENV) $(DEMO) build docs/_build *.egg-info .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
