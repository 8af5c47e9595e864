# make demo: measure a material and look at it.   make test: what a change is checked by.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUN ?= runs/demo
SHARED := $(abspath ../shared/materials/rgl)
ifneq ($(wildcard $(SHARED)/*.bsdf),)
export GONIO_MATERIALS ?= $(SHARED)
endif
# one thread a process: two busy processes with two OpenMP threads each are far slower than with one
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MPLCONFIGDIR := $(abspath $(VENV))/matplotlib

.PHONY: help demo test test-all bench-quick lint docs clean
help:
	@echo "make demo   measure chm_orange on a simulated rig: BRDF, .bsdf and report in $(RUN)"
	@echo "make test   the test suite without its slow tests"
	@echo "make test-all   the whole test suite"
	@echo "make bench-quick   warn of what became slow (1 min)"
	@echo "make lint   ruff, types, import directions"
	@echo "make docs   the docs as a site in runs/site; a warning is an error"

$(VENV)/base: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q --disable-pip-version-check -e .
	touch $@

# torch first and pinned: a plain `torch` brings gigabytes of CUDA
$(VENV)/all: $(VENV)/base
	$(BIN)/pip install -q --disable-pip-version-check torch==2.13.0
	$(BIN)/pip install -q --disable-pip-version-check -e '.[all]'
	touch $@

demo: $(VENV)/base
	rm -rf $(RUN)
	@$(BIN)/gonio materials fetch --missing --within 10 chm_orange || echo 'no measured table: the fit that ships is measured instead'
	$(BIN)/gonio acquire configs/materials/chm_orange.yaml --rig configs/rigs/sim.yaml --out $(RUN)
	$(BIN)/gonio evaluate $(RUN)

test: $(VENV)/all
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow"

test-all: $(VENV)/all
	$(BIN)/python -m pytest -n 2 --dist worksteal

# warns of what became slow beside the committed reference, as ratios to a calibration loop; fails never
bench-quick: $(VENV)/all
	@$(BIN)/gonio bench quick || true

lint: $(VENV)/all
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python tests/imports.py

docs: $(VENV)/all
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict -q -f .ci/mkdocs.yml

clean:
	rm -rf $(VENV) runs/demo
