# `make demo` and `make test` do all their set-up; nothing but Python 3.11 or newer is needed.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
BIN := $(VENV)/bin
# A process for each core; a file's tests stay in one process, which keeps the kernels that it has built. Files in their
# order, as those of few tests may take long.
PARALLEL ?= --numprocesses auto --dist loadfile --no-loadscope-reorder

.PHONY: demo test test-all lint format reference-images golden runtimes contact-sheet \
	bench-check bench-check-update clean

demo: $(VENV)/installed
	@mkdir -p out
	$(BIN)/splatcl render reference_images/scans/bunny.pts -o out/demo.exr --png out/demo.png \
		--size 800x600 --azimuth 20 --elevation 10
	@echo "Open out/demo.png; out/demo.exr holds every buffer."

test: $(VENV)/installed-test
	$(BIN)/python -m pytest -m "not slow" $(PARALLEL)

test-all: test
	$(BIN)/python -m pytest -m slow

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/installed-test
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Renders every reference image again and rewrites reference_images/README.md.
reference-images: $(VENV)/installed-test
	$(BIN)/python reference_images/regenerate.py

# Computes the hashes of splatcl/golden.json again: only after a wanted change of bits.
golden: $(VENV)/installed-test
	$(BIN)/python -m splatcl.evidence.golden.check

# The golden images on five OpenCL runtimes; writes the table of docs/trust/reproducibility.md.
runtimes: $(VENV)/installed-test
	VENV=$(VENV) .ci/runtimes docs/trust/reproducibility.md

# Renders every model of a folder to docs/images/contact_sheet.png: make contact-sheet MODELS=path
contact-sheet: $(VENV)/installed-test
	$(BIN)/python docs/images/contact_sheet.py $(MODELS)

# Each pass' time against a calibration kernel of the same run, compared with what is stored; about a minute, on a
# machine that does nothing else (docs/speed/bench.md).
bench-check: $(VENV)/installed-test
	$(BIN)/python -m splatcl.apps.bench.guard docs/speed/bench_ratios.json

# Stores the ratios of now: after a wanted change of speed.
bench-check-update: $(VENV)/installed-test
	$(BIN)/python -m splatcl.apps.bench.guard docs/speed/bench_ratios.json --update

$(VENV)/installed: pyproject.toml
	@echo "Installing splatcl into $(VENV) (about a minute) ..."
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --disable-pip-version-check --progress-bar off --quiet -e '.[all]'
	@touch $@

$(VENV)/installed-test: $(VENV)/installed
	@echo "Installing the test tools (about a minute) ..."
	$(BIN)/python -m pip install --disable-pip-version-check --progress-bar off --quiet -e '.[test]'
	@touch $@

clean:
	rm -rf $(VENV) out build dist *.egg-info
