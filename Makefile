# Everything needs only python3 with venv and pip, and a C compiler if there is one.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
export PYTHONPATH := $(CURDIR)

.PHONY: demo test check bench validate clean setup

setup: $(READY)

$(READY): pyproject.toml requirements.lock setup.py $(wildcard inhalemon/*.pyx inhalemon/*.pxd inhalemon/stages/*.pxd)
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -e '.[parquet,service,postgres,fhir,test,check]'
	touch $(READY)

demo: $(READY)
	$(BIN)/inhalemon score sample_data

test: $(READY)
	$(BIN)/python -m pytest

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -m 'not slow and not browser' -x

clean:
	rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
