# `make demo` and `make test` do all their set-up; nothing but Python 3.11 or newer is needed.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
BIN := $(VENV)/bin
# A process for each core takes a run of neighboring tests, and takes over some of another's when it is done. The
# runtime's cache on disk holds the kernels that any of them has built.
PARALLEL ?= --numprocesses auto --dist worksteal
# The third of the slow tests that `make test-slow` runs: 1, 2 or 3; all of them where it is empty.
THIRD ?=

.PHONY: help demo test test-slow test-all lint format reference-images golden runtimes contact-sheet \
	bench-check bench-check-update clean

help: ## print this list
	@sed -n 's/^\([a-z-]*\):.*## /\1|/p' $(MAKEFILE_LIST) | while IFS='|' read -r target text; do \
		printf '%-20s %s\n' "$$target" "$$text"; done

demo: $(VENV)/installed ## render the bunny to out/demo.png and out/demo.exr
	@mkdir -p out
	$(BIN)/splatcl render reference_images/scans/bunny.pts -o out/demo.exr --png out/demo.png \
		--size 800x600 --azimuth 20 --elevation 10
	@echo "Open out/demo.png; out/demo.exr holds every buffer."

test: $(VENV)/installed-test ## pass the tests, in a few minutes
	$(BIN)/python -m pytest -m "not slow" $(PARALLEL)

test-slow: $(VENV)/installed-test ## pass the slow tests, or a third of them: make test-slow THIRD=1
	$(BIN)/python -m pytest -m slow $(if $(THIRD),--slow-third=$(THIRD)) $(PARALLEL)

test-all: test test-slow ## pass all tests

lint: $(VENV)/installed-test ## run ruff, mypy and the check that imports go down
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(VENV)/installed-test ## let ruff fix and format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

reference-images: $(VENV)/installed-test ## render the reference images again and rewrite their README
	$(BIN)/python reference_images/regenerate.py

golden: $(VENV)/installed-test ## write the hashes of the golden images again, after a wanted change of bits
	$(BIN)/python -m splatcl.evidence.golden.check

runtimes: $(VENV)/installed-test ## check the golden images on five OpenCL runtimes; write docs/trust/reproducibility.md
	VENV=$(VENV) .ci/runtimes docs/trust/reproducibility.md

contact-sheet: $(VENV)/installed-test ## render a folder's models to docs/images/contact_sheet.png: MODELS=path
	$(BIN)/python docs/images/contact_sheet.py $(MODELS)

# Takes about a minute, on a machine that does nothing else (docs/speed/bench.md).
bench-check: $(VENV)/installed-test ## compare each pass's time with the stored one
	$(BIN)/python -m splatcl.apps.bench.guard docs/speed/bench_ratios.json

bench-check-update: $(VENV)/installed-test ## store the passes' times, after a wanted change of speed
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

clean: ## remove everything that make has made
	rm -rf $(VENV) out build dist *.egg-info
