# Each target creates what it needs: Python 3.11+, gcc and make are enough.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: demo test lint bench firmware clean

demo: $(INSTALLED)
	$(BIN)/hapticd demo

test: $(INSTALLED)
	$(BIN)/python -m pytest -n 2

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(INSTALLED)
	$(BIN)/hapticd bench all

firmware:
	$(MAKE) -C firmware

$(INSTALLED): pyproject.toml clients/python/pyproject.toml $(wildcard firmware/core/*.[ch] firmware/boards/host/*.[ch])
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable ".[plot,test,lint]" --editable clients/python
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info hapticd/sim/*.so
	$(MAKE) -C firmware clean
