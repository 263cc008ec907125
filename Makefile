# Every target sets up its own virtual environment; `make demo` and `make test` are all a newcomer needs.
PYTHON ?= python3
VENV   := .venv
RUN    := $(VENV)/bin/python
PIP    := $(RUN) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: demo test test-slow test-lab mutate lint bench docs clean

demo: $(VENV)/.lab
	$(RUN) -m fieldkit demo

test: $(VENV)/.test
	$(RUN) -m pytest -m "not slow" --numprocesses logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder

test-slow: $(VENV)/.test
	$(RUN) -m pytest -m slow --timeout 3600

test-lab: $(VENV)/.test
	$(RUN) -m pytest tests/lab --timeout 600

mutate: $(VENV)/.test
	$(RUN) tests/mutate.py $(ROOM)

lint: $(VENV)/.lint
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy -p fieldkit -p benchmarks
	$(VENV)/bin/lint-imports
	$(RUN) docs/check_types.py

bench: $(VENV)/.test
	$(RUN) -m benchmarks

docs: $(VENV)/.docs
	$(RUN) -m mkdocs build --strict

clean:
	rm -rf $(VENV) build dist site demo .mypy_cache .ruff_cache .pytest_cache

$(VENV)/.lab: pyproject.toml constraints.txt
	test -x $(RUN) || $(PYTHON) -m venv $(VENV)
	$(PIP) --editable '.[lab]'
	touch $@

$(VENV)/.test $(VENV)/.lint $(VENV)/.docs: $(VENV)/.%: pyproject.toml constraints.txt
	test -x $(RUN) || $(PYTHON) -m venv $(VENV)
	$(PIP) --editable '.[lab,gps,page,$*]'
	touch $@
