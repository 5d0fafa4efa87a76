# Each target creates what it needs: Python 3.11+, gcc and make are enough.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: demo test coverage fuzz lint bench firmware clean

demo: $(INSTALLED)
	$(BIN)/hapticd demo

test: $(INSTALLED)
	$(BIN)/python -m pytest -n 2 -m "not virtual_machine and not alone"
	$(BIN)/python -m pytest -p no:xdist -m alone

# Every branch of the limits, the supervisor and the decoders, as Python: machine code has no lines.
coverage: $(INSTALLED)
	HAPTICD_PURE=1 $(BIN)/coverage run -m pytest -p no:xdist tests/core/trajectory/test_gate.py tests/core/board/test_supervisor.py tests/wire \
	    tests/config tests/files/test_calibration.py tests/files/test_mode_map.py
	$(BIN)/coverage report

# New inputs to every decoder and scripts to the firmware's core, FUZZ_SECONDS each; what is found goes to build/fuzz.
FUZZ_SECONDS ?= 300
fuzz: $(INSTALLED)
	mkdir -p build/fuzz && cd build/fuzz && ../../$(BIN)/python ../../tests/fuzz/explore.py --seconds $(FUZZ_SECONDS)
	@if command -v clang >/dev/null; then $(MAKE) -C firmware fuzz FUZZ_SECONDS=$(FUZZ_SECONDS); \
	else echo "skipped: the firmware's core, for clang is not installed (apt: clang libclang-rt-dev)"; fi

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(INSTALLED)
	$(BIN)/hapticd bench all

firmware:
	$(MAKE) -C firmware

# What is compiled at installation: the firmware for the simulated board, and the touch path.
COMPILED := $(wildcard firmware/core/*.[ch] firmware/boards/host/*.[ch] hapticd/core/*.py hapticd/core/*/*.py hapticd/wire/*.py hapticd/wire/*/*.py hapticd/compiled/build_ext.py)

$(INSTALLED): pyproject.toml clients/python/pyproject.toml $(COMPILED)
	@echo "Everything goes into $(VENV); compiling the touch path takes some minutes."
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable ".[plot,test,lint]" --editable clients/python
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info hapticd/core/*.so hapticd/core/*/*.so hapticd/wire/*.so hapticd/wire/*/*.so hapticd/sim/board/*.so
	$(MAKE) -C firmware clean
