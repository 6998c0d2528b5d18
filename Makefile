# Two commands: `make bench` measures, `make test` tests. Everything is kept inside this folder.
#
#   make test-all                      the slow tests too
#   make docs                         docs/ as a site, in build/docs
#   make bench ARGS="--limit 12"       further options for `bench run`
#   make bench PIP_ARGS="..."          further options for pip, an index of CPU-only torch say

PYTHON ?= python3
VENV := .venv
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check
ARGS ?=
PIP_ARGS ?=

.PHONY: bench test test-all docs install libraries test-libraries clean

bench: install
	$(VENV)/bin/bench run --suite chair-robustness $(ARGS)

test: test-libraries $(VENV)/bin/tox
	$(VENV)/bin/tox run

test-all: test
	$(VENV)/bin/tox exec -e test -- pytest -n 2 --dist loadgroup -m slow

docs: install
	$(PIP) install $(PIP_ARGS) -c constraints.txt -e '.[docs]'
	$(VENV)/bin/sphinx-build -b html docs build/docs

install: libraries $(VENV)/installed

WITHOUT_DEPENDENCIES := bench/commands/without-dependencies.txt
$(VENV)/installed: pyproject.toml constraints.txt $(WITHOUT_DEPENDENCIES) | $(VENV)/bin/python
	$(PIP) install $(PIP_ARGS) -c constraints.txt -e .
	$(PIP) install $(PIP_ARGS) --no-deps -r $(WITHOUT_DEPENDENCIES)
	touch $@

$(VENV)/bin/tox: constraints.txt | $(VENV)/bin/python
	$(PIP) install $(PIP_ARGS) -c constraints.txt tox
	touch $@

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

libraries:
	@sh .ci/libraries

test-libraries:
	@sh .ci/libraries tests

clean:
	rm -rf $(VENV) .tox build *.egg-info
