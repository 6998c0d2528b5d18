# Two commands: `make bench` measures, `make test` tests. Everything is kept inside this folder.
#
#   make test-all                      the slow tests too
#   make docs                         docs/ as a site, in build/docs
#   make wheel                         a file that pip installs, in dist/
#   make release                       what a release needs: versions, numbers of the pages, wheel, tag
#   make version VERSION=3.0.0         one version and the date of today wherever they stand
#   make version ... URL=https://...   and where the release is published, for `bench cite`
#   make bench ARGS="--limit 12"       further options for `bench run`
#   make bench PIP_ARGS="..."          further options for pip, an index of CPU-only torch say

PYTHON ?= python3
VENV := .venv
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check
ARGS ?=
PIP_ARGS ?=
DATE ?= $(shell date +%F)

.PHONY: bench test test-all docs install libraries test-libraries wheel release version clean

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

wheel: install
	rm -rf build/lib dist
	$(PIP) wheel --quiet --no-deps -w dist .
	@echo "dist/$$(ls dist): pip install it, then bench doctor --install"

# The environment and the folder of the run hold nothing but the wheel: it needs no checkout.
RELEASE := build/release
release: install
	@test -z "$$(git status --porcelain)" || { git status --short >&2; echo "commit these first" >&2; exit 1; }
	$(VENV)/bin/python -m studies.release
	$(VENV)/bin/python -m studies.documents --check
	rm -rf $(RELEASE)
	$(MAKE) wheel
	$(PYTHON) -m venv $(RELEASE)/env
	$(RELEASE)/env/bin/python -m pip install --quiet $(PIP_ARGS) -c constraints.txt dist/*.whl
	cd $(RELEASE) && set -e; for command in --version "list methods" "doctor --install" \
	    "run --suite chair-robustness --limit 2 --out run" "check run"; do env/bin/bench $$command; done
	git clone --quiet "file://$(CURDIR)" $(RELEASE)/clone
	git clone --quiet --depth 1 "file://$(CURDIR)" $(RELEASE)/shallow-clone
	du -sh dist/* $(RELEASE)/* $(VENV)
	sed -n 's/^version = "\(.*\)"/v\1/p' pyproject.toml | xargs -I TAG git tag --annotate --message TAG TAG

version:
	@test -n "$(VERSION)" || { echo "give the version: make version VERSION=3.0.0" >&2; exit 2; }
	sed -i 's/^version = .*/version = "$(VERSION)"/' pyproject.toml
	sed -i -E 's/^( *version:) .*/\1 $(VERSION)/; s/^(date-released:) .*/\1 $(DATE)/' CITATION.cff
	sed -i -E 's/^(  year:) .*/\1 $(firstword $(subst -, ,$(DATE)))/' CITATION.cff
	sed -i -E '/^@misc/,/^}/ { s/(Version )[^}]*/\1$(VERSION)/; s/^(  year = ).*/\1{$(firstword $(subst -, ,$(DATE)))},/ }' README.md
	sed -i -E 's/^## \[$(VERSION)\] - .*/## [$(VERSION)] - $(DATE)/' CHANGELOG.md
ifdef URL
	sed -i -E -e '/^  repository-code:/d' -e 's|^  license: MIT$$|&\n  repository-code: "$(URL)"|' CITATION.cff
	sed -i -E -e '/^  url = /d' -e '/^@misc/,/^}/ s|^  note = .*|&\n  url = {$(URL)},|' README.md
endif

clean:
	rm -rf $(VENV) .tox build dist *.egg-info
