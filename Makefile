# One file per environment: make re-installs when pyproject.toml or the lock changes.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP_RUN := $(VENV)/.installed-run
STAMP_TEST := $(VENV)/.installed-test
STAMP_ALL := $(VENV)/.installed-all
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
CONSTRAINTS := constraints.txt
BUILT := $(patsubst notebooks/%.py,notebooks/_built/%.ipynb,$(wildcard notebooks/*.py))
NBMAKE := $(BIN)/python -m pytest --nbmake --nbmake-timeout=1800 -p no:xdist --durations=0

.PHONY: fuzz mutants demo test test-slow setup lint types contracts python-next notebooks notebooks-check bench study docs clean lock

$(BIN)/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(None if (3, 11) <= v <= (3, 14) else "dmoc runs on Python 3.11 to 3.14, and $(PYTHON) is %d.%d: name another one with make PYTHON=python3.12" % v)'
	$(PYTHON) -m venv $(VENV)

$(STAMP_RUN): pyproject.toml $(CONSTRAINTS) | $(BIN)/python
	$(PIP) -c $(CONSTRAINTS) -e .
	touch $@

$(STAMP_TEST): pyproject.toml $(CONSTRAINTS) | $(BIN)/python
	$(PIP) -c $(CONSTRAINTS) -e '.[test,notebooks]'
	touch $@ $(STAMP_RUN)

$(STAMP_ALL): pyproject.toml $(CONSTRAINTS) | $(BIN)/python
	$(PIP) -c $(CONSTRAINTS) -e '.[test,notebooks,bench,docs]'
	touch $@ $(STAMP_RUN) $(STAMP_TEST)

setup: $(STAMP_ALL)

demo: $(STAMP_RUN)
	$(BIN)/dmoc demo

test: lint types contracts
	$(BIN)/python -m pytest -n 2 --dist loadgroup --no-loadscope-reorder
	$(MAKE) notebooks-check

lint: $(STAMP_TEST)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP_TEST)
	$(BIN)/mypy

contracts: $(STAMP_TEST)
	$(BIN)/lint-imports

fuzz: $(STAMP_TEST)
	DMOC_FUZZ=5000 $(BIN)/python -m pytest -n 2 tests/fuzz

# Puts each slip of tests/mutants.py into a copy of the sources; its test must fail.
mutants: $(STAMP_TEST)
	$(BIN)/python -m tests.mutants

# Whether the dependencies have wheels for the newest Python that is let in (asks PyPI).
python-next: $(STAMP_TEST)
	$(BIN)/python -m pytest -m slow tests/test_python_versions.py

test-slow: $(STAMP_TEST)
	$(BIN)/python -m pytest -n 2 -m slow

# One notebook: make notebooks BUILT=notebooks/_built/quickstart.ipynb
notebooks/_built/%.ipynb: notebooks/%.py | $(STAMP_TEST)
	@mkdir -p $(@D)
	$(BIN)/jupytext --quiet --to ipynb --output $@ $<

notebooks-check: $(BUILT)
	DMOC_REDUCED=1 $(NBMAKE) $(BUILT)

notebooks: $(BUILT)
	env -u DMOC_REDUCED $(NBMAKE) --overwrite $(BUILT)
	$(BIN)/jupyter nbconvert --log-level WARN --to html $(BUILT)

bench: $(STAMP_ALL)
	$(BIN)/python -m benchmarks

study: $(STAMP_RUN)
	$(BIN)/dmoc study stud-welding

docs: $(STAMP_ALL)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Freeze what is installed in a fresh environment; CI and make install with these versions.
lock: $(STAMP_ALL)
	$(BIN)/python -m pip freeze --exclude-editable > $(CONSTRAINTS)

clean:
	rm -rf $(VENV) build dist runs notebooks/_built .pytest_cache .mypy_cache .ruff_cache
	find . -name "*.nb[ic]" -delete
