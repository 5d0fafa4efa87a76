# Each target installs what it needs into .venv: Python 3.11+, gcc and make are enough.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Of what is installed less than half is ever imported: Python compiles it then.
PIP := PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
INSTALL := $(PIP) --no-build-isolation --no-deps --editable .
LOCKED := $(PIP) --no-deps --require-hashes --requirement
PACKAGES := $(VENV)/.packages
PURE := $(VENV)/.pure
HAPTICD := $(VENV)/.hapticd
TESTS := $(VENV)/.tests
LINT := $(VENV)/.lint
DOCS := $(VENV)/.docs

.PHONY: demo test test-all coverage fuzz lint bench firmware docs view-picture lock version clean uncompiled

# The first demo runs as Python, for machine code takes longer to build than all else; `make test` builds it.
demo: $(if $(wildcard $(HAPTICD)),$(HAPTICD),$(PURE))
	$(BIN)/hapticd demo --force

# Proves the product. Property tests look at the same examples each time: everybody gets the same answer. (A third of the
# time is spent waiting for processes and timeouts, so two cores have work for three. Files stay whole, so that the
# fixtures of one are made once.)
test: $(TESTS)
	$(BIN)/python -m pytest -n 3 --dist loadfile -m "not long and not alone"

# $(call of,word): the files of tests with it, for pytest takes seconds to import all.
of = $$(grep -rl --include='test_*.py' '$(1)' tests clients/study/tests)

# What `make test` leaves out: new property examples, emulated machines, browsers, real time alone.
# Files stay whole, because the tests of one share the boot of their machine (tests/virtual_machine/make_guest.sh makes it).
# A rig keeps to real time and a busy machine may not: what fails there runs again alone, and must pass then.
test-all: $(TESTS)
	NEW_EXAMPLES=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m "hypothesis and not alone" $(call of,hypothesis)
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder -rs --durations=40 -m "long and not hypothesis and not alone" \
	    $(call of,mark.long) || $(BIN)/python -m pytest -p no:xdist -rs -m long --last-failed --last-failed-no-failures none
	$(BIN)/python -m pytest -p no:xdist -rs -m alone $(call of,mark.alone)

# Every branch of the limits, the supervisor and the decoders, as Python: machine code has no lines.
coverage: $(TESTS)
	HAPTICD_PURE=1 $(BIN)/coverage run -m pytest -p no:xdist tests/core/trajectory/test_gate.py tests/core/board/test_supervisor.py tests/wire \
	    tests/config tests/files/test_calibration.py tests/formats/test_mode_map.py
	$(BIN)/coverage report

# New inputs to every decoder and scripts to the firmware's core, FUZZ_SECONDS each; findings go to build/fuzz.
FUZZ_SECONDS ?= 300
fuzz: $(TESTS)
	mkdir -p build/fuzz && cd build/fuzz && ../../$(BIN)/python ../../tests/fuzz/explore.py --seconds $(FUZZ_SECONDS)
	@if command -v clang >/dev/null; then $(MAKE) -C firmware fuzz FUZZ_SECONDS=$(FUZZ_SECONDS); \
	else echo "skipped: the firmware's core, because clang is not installed (apt: clang libclang-rt-dev)"; fi

lint: $(LINT)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(TESTS)
	$(BIN)/hapticd bench all

firmware:
	$(MAKE) -C firmware

# The picture of the page, by chromium.
view-picture: $(TESTS)
	$(BIN)/python .github/view.py .github/view.png

# The reference of the library and of the daemon's rooms, from their docstrings: build/docs/index.html.
docs: $(DOCS)
	HAPTICD_PURE=1 PYTHONWARNINGS=ignore $(BIN)/python -m pdoc --output-directory build/docs hapticd_client hapticd.values \
	    hapticd.board_values hapticd.core hapticd.wire hapticd.config hapticd.design hapticd.sim

# Writes it where hapticd/__init__.py cannot be read too; tests/test_packaging.py holds all equal.
VERSION ?= $(error usage: make version VERSION=1.2.3)
version:
	sed -i -E 's/^(__version__ = ")[^"]*/\1$(VERSION)/' hapticd/__init__.py
	sed -i -E 's/^(version = ")[^"]*/\1$(VERSION)/' clients/python/pyproject.toml
	sed -i -E 's/^(__version__ = ")[^"]*/\1$(VERSION)/' clients/study/hapticd_study/__init__.py
	sed -i -E 's/^(version: ).*/\1$(VERSION)/' .github/CITATION.cff
	sed -i -E 's/^(#define HD_FIRMWARE_VERSION ")[^"]*/\1$(VERSION)/' firmware/core/core.h

# What installation compiles: the firmware for the simulated board, and the touch path.
COMPILED := $(wildcard firmware/core/*.[ch] firmware/boards/host/*.[ch] firmware/make_protocol.py hapticd/core/*.py hapticd/core/*/*.py hapticd/core/*/*/*.py hapticd/core/*/*.[ch] \
    hapticd/wire/*.py hapticd/wire/*/*.py hapticd/compiled/*.py)

# Installation makes it of firmware/core/protocol.h; this is for a checkout of another commit that was installed before.
hapticd/board_protocol.py:
	@! test -e $(PACKAGES) || $(PYTHON) firmware/make_protocol.py

$(PACKAGES): .lock/build.txt .lock/demo.txt | hapticd/board_protocol.py
	@$(PYTHON) hapticd/compiled/prerequisites.py
	@echo "Everything goes into $(VENV)."
	$(PYTHON) -m venv $(VENV)
	$(LOCKED) .lock/build.txt & build=$$!; $(LOCKED) .lock/demo.txt && wait $$build
	touch $@

$(PURE): pyproject.toml $(PACKAGES) $(filter %.c %.h,$(COMPILED))
	HAPTICD_PURE=1 $(INSTALL)
	touch $@

# Without pip's isolated build, which would download and unpack mypy and numpy a second time.
$(HAPTICD): pyproject.toml $(PACKAGES) $(COMPILED)
	@echo "Compiling the touch path takes about half a minute."
	$(INSTALL)
	touch $@

# Where nothing is compiled yet, packages are unpacked while one processor compiles the touch path.
$(TESTS): $(or $(wildcard $(HAPTICD)),uncompiled) $(PACKAGES) .lock/test.txt clients/study/pyproject.toml
	$(MAKE) --no-print-directory $(HAPTICD) & compiled=$$!; $(LOCKED) .lock/test.txt && wait $$compiled
	$(PIP) --no-build-isolation --no-deps --editable clients/study
	touch $@

$(LINT): $(TESTS) .lock/lint.txt
	$(LOCKED) .lock/lint.txt
	touch $@

$(DOCS): $(TESTS) .lock/docs.txt
	$(LOCKED) .lock/docs.txt
	touch $@

# The newest versions that pyproject.toml allows, for each Python and platform.
lock: $(HAPTICD)
	$(PIP) uv
	$(BIN)/python .lock/lock.py

clean:
	rm -rf $(VENV) build dist *.egg-info hapticd/core/*.so hapticd/core/*/*.so hapticd/wire/*.so hapticd/sim/board/*.so
	$(MAKE) -C firmware clean
