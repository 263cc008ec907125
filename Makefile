# Every target sets up its own virtual environment; `make demo` and `make test` are all a newcomer needs.
PYTHON ?= python3
VENV   := .venv
RUN    := $(VENV)/bin/python
DIST   := dist
PIP    := $(RUN) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

# A worker for each processor: threads of the linear algebra would only take turns with them.
test: export OPENBLAS_NUM_THREADS := 1

# Where it is set, each of the thousand processes that the tests start compiles every library again.
unexport PYTHONDONTWRITEBYTECODE

PYTHONS ?= python3.11 python3.12 python3.13 python3.14

.PHONY: demo test test-slow test-lab test-wheel test-lowest test-newest test-deb mutate same lint bench docs images dist deb sbom clean

demo: $(VENV)/.lab
	$(RUN) -m fieldkit demo

# One worker more than there are processors: some tests wait, for real seconds or for a browser.
test: WORKERS := $(shell expr $$(nproc) + 1)
test: $(VENV)/.test
	$(RUN) -m pytest -m "not slow" --numprocesses $(WORKERS) --maxprocesses 5 --dist loadfile --no-loadscope-reorder

test-slow: $(VENV)/.test
	$(RUN) -m pytest -m slow --timeout 3600
	$(RUN) -m pytest --hypothesis-profile thorough --timeout 3600 tests/property

test-lab: $(VENV)/.test $(VENV)/.genicam
	$(RUN) -m pytest tests/lab --timeout 600

# The wheel in new environments: with each Python, and with the lowest and newest versions of its libraries.
test-wheel: dist
	$(RUN) tests/wheel.py $(PYTHONS)

test-lowest: dist
	PATH="$(CURDIR)/$(VENV)/bin:$$PATH" $(RUN) tests/wheel.py --lowest python3.11

test-newest: dist
	$(RUN) tests/wheel.py --newest python3.13 python3.14

# Needs root and debootstrap: a new Debian in build/, in which the package is installed, used and purged.
test-deb: deb
	packaging/debian/test.sh

mutate: $(VENV)/.test
	$(RUN) tests/mutate.py $(ROOM)

# The same sessions, recorded by this checkout and by another with its own .venv: every value that differs.
same: $(VENV)/.test
	$(RUN) -m tests.same $(OTHER)

lint: $(VENV)/.lint
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy -p fieldkit -p benchmarks
	$(VENV)/bin/lint-imports
	$(RUN) docs/check_types.py

bench: $(VENV)/.test
	$(RUN) -m benchmarks

docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --strict
	$(RUN) docs/check_site.py

# Every screenshot and plot of the documentation, some minutes; needs Chromium.
images: $(VENV)/.test
	$(RUN) docs/images/make.py

# Reproducible: the date of the last commit stands in the archives, and a second build must equal the first.
dist: export SOURCE_DATE_EPOCH := $(shell git log -1 --format=%ct 2>/dev/null || echo 1700000000)
dist: $(VENV)/.release
	rm -rf $(DIST) build/again
	$(RUN) -m build --outdir $(DIST) .
	$(RUN) -m build --outdir build/again .
	diff --recursive $(DIST) build/again
	$(RUN) -m twine check --strict $(DIST)/*
	$(VENV)/bin/check-wheel-contents $(DIST)/*.whl

# For the Debian release and the architecture that this runs on.
deb: dist
	packaging/debian/build.sh

# What an installation with every extra contains, in CycloneDX.
sbom: $(VENV)/.release
	rm -rf build/installed
	$(RUN) -m venv build/installed
	build/installed/bin/python -m pip install --quiet --constraint constraints.txt '.[lab,alarms,dask,files,network,page,pdf,terrain]'
	mkdir -p $(DIST)
	$(VENV)/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --of JSON -o $(DIST)/sbom.cdx.json build/installed

clean:
	rm -rf $(VENV) build dist site demo .mypy_cache .ruff_cache .pytest_cache

$(VENV)/.pip:
	test -x $(RUN) || $(PYTHON) -m venv $(VENV)
	$(PIP) --upgrade 'pip>=25.1' # the first with --group
	touch $@

$(VENV)/.lab: pyproject.toml constraints.txt $(VENV)/.pip
	$(PIP) --editable '.[lab]'
	touch $@

# Built against the system's GObject introspection; where that is missing, the tests that need it are skipped.
$(VENV)/.genicam: $(VENV)/.test
	-$(PIP) --editable '.[genicam]'
	touch $@

$(VENV)/.test $(VENV)/.lint $(VENV)/.docs $(VENV)/.release: $(VENV)/.%: pyproject.toml constraints.txt $(VENV)/.pip
	$(PIP) --editable '.[lab,alarms,files,network,page,terrain]' --group $*
	touch $@
