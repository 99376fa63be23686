# Everything needs only python3 with venv and pip, and a C compiler if there is one.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint requirements.lock
# Chosen once: two test processes, the smallest machine this is tested on.
PYTEST_JOBS ?= 2
# What `make serve` hands on, as in: make serve ARGS=--with-samples
ARGS ?=
export PYTHONPATH := $(CURDIR)

SOURCES := pyproject.toml requirements.lock setup.py $(wildcard inhalemon/_*kernel*.p*)

.PHONY: demo test check fuzz bench bench-api validate docs serve setup lock clean

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

# The program alone is enough for the demo; tests and checks want the extras.
$(VENV)/.program: $(SOURCES) | $(BIN)/python
	$(PIP) --editable .
	touch $@

$(VENV)/.everything: $(SOURCES) | $(BIN)/python
	$(PIP) --editable '.[parquet,service,postgres,fhir,oidc,figures,test,check]'
	touch $(VENV)/.program $@

setup: $(VENV)/.everything

demo: $(VENV)/.program
	$(BIN)/inhalemon score sample_data

test: $(VENV)/.everything
	$(BIN)/python -m pytest -n $(PYTEST_JOBS)

check: $(VENV)/.everything
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -m 'not slow and not browser' -x -n $(PYTEST_JOBS)

# Coverage-guided, for SECONDS; needs atheris: pip install -e '.[fuzz]' (Python 3.11).
SECONDS ?= 60
fuzz: $(VENV)/.everything
	$(BIN)/python tests/fuzz/recording.py $(SECONDS)

bench: $(VENV)/.everything
	$(BIN)/python -m pytest benchmarks

bench-api: $(VENV)/.everything
	$(BIN)/python -m benchmarks.api

validate: $(VENV)/.everything
	$(BIN)/python -m validation

# What README shows of the program, its example and its figures; a test compares.
docs: $(VENV)/.everything
	$(BIN)/python docs/make_picture.py
	$(BIN)/python docs/fill_readme.py

serve: $(VENV)/.everything
	$(BIN)/inhalemon serve $(ARGS)

# The versions that the tests ran with, for Python 3.11 to 3.13: names and versions only.
lock:
	rm -rf build/lock
	$(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet --disable-pip-version-check \
		--editable '.[parquet,service,postgres,fhir,oidc,dask,figures,test,check,fuzz]'
	PYTHONPATH= build/lock/bin/python -m pip freeze --exclude-editable > requirements.lock
	rm -rf build/lock

clean:
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
