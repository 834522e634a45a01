# Everything goes through these; see README.md.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
RUN := $(VENV)/bin/python
ZIP := dist/icymoon.zip
# A process more than processors, as some always wait for a disk or a worker, but 4 at most: each has a Blender of its
# own, about 2 GiB of memory.
PROCESSES ?= $(shell echo $$(($$(nproc 2>/dev/null || echo 2) + 1)))
PYTEST := PYTHONPATH=tests/support $(RUN) -m pytest -p processor_time --numprocesses $(PROCESSES) --maxprocesses 4 \
  --dist worksteal
# What every change is tried by, and the environments of test-ends.
QUICK := not slow and not heavy and not long

# Without their compiled files each of these processes would compile the tests and the package anew, for 10 s.
unexport PYTHONDONTWRITEBYTECODE

# Runs the tests of these options with the type checker beside them, which uses one processor. It fails the target as a
# test does, and what it finds is told last. CI checks types later, beside the window that it drives: it sets this to
# true.
TYPE_CHECK ?= $(VENV)/bin/mypy
define TESTS
@told=$$(mktemp); $(TYPE_CHECK) >"$$told" 2>&1 & types=$$!; trap "kill $$types" INT TERM; \
  $(PYTEST) $(1); tests_failed=$$?; \
  wait $$types; types_failed=$$?; trap - INT TERM; \
  cat "$$told"; rm "$$told"; exit $$((tests_failed ? tests_failed : types_failed))
endef

.PHONY: demo env test test-ci test-all test-lanes measure-tests test-ends mutants style lint zip store lock docs \
  docs-pages clean

demo: $(VENV)/.demo
	$(RUN) -m icymoon demo

env: $(VENV)/.tests

test: $(VENV)/.tests style .types/icymoon
	$(call TESTS,-m "$(QUICK) and not left_to_ci")

test-ci: $(VENV)/.tests style .types/icymoon
	$(call TESTS,-m "not long")

test-all: $(VENV)/.tests style .types/icymoon
	$(call TESTS,)

# Every Blender that can be had: wheels 4.2, 4.5 and 5.2, real Blenders with their window.
test-lanes: $(VENV)/.tests zip
	$(RUN) tests/lanes.py

# Brings tests/left_to_ci.txt up to date, the list of the tests that `make test` leaves to CI. The other targets tell
# which places in it are wrong.
measure-tests: $(VENV)/.tests
	$(PYTEST) --measure-tests -m "not long"

# The evaluator's tests with the oldest and with the newest packages that it takes, in environments without Blender.
test-ends: $(VENV)/bin/python
	for end in lowest newest; do \
	  $(PYTHON) -m venv .venvs/$$end && \
	  .venvs/$$end/bin/python -m pip install --quiet --disable-pip-version-check -c constraints/$$end.txt \
	    -e ".[evaluate]" pytest pytest-timeout hypothesis packaging && \
	  .venvs/$$end/bin/python -m pytest -m "$(QUICK)" tests/stereo/images tests/stereo/report \
	    tests/stereo/matchers || exit 1; \
	done

# Makes small defects in the modules that matter and lists those that no test notices. One module: `make mutants
# OF=render.workers.pair_claims`.
mutants: $(VENV)/.mutants
	$(RUN) tests/mutants.py $(OF)

style: $(VENV)/.tests
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check --quiet .

lint: style .types/icymoon
	$(VENV)/bin/mypy

# A link to the repository under the package's name, by which mypy finds it whatever the folder is called.
.types/icymoon:
	mkdir -p $(@D)
	ln -s .. $@

zip: $(VENV)/.demo
	$(RUN) tests/extension_zip.py $(ZIP)

# The extension with the evaluator's packages inside, for each Python and platform: `make store WEBSITE=https://…`
store: $(VENV)/.demo
	$(RUN) tests/store_zip.py --website "$(WEBSITE)"

# What Install Evaluator installs, anew: the newest versions within the tested bounds, but OpenCV as the tests have it.
lock: $(VENV)/.tests
	$(RUN) tests/lock.py opencv-contrib-python-headless==4.11.0.86

# Writes anew the pages and figures of docs/ that are made from the code.
docs-pages: $(VENV)/.tests
	$(RUN) docs/make/generated.py

# The manual, as pages that need no server and no network: dist/manual/index.html.
docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict --quiet
	@echo "Open dist/manual/index.html"

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in [(3, 11), (3, 13)] and "Icy Moon needs Python 3.11 (or 3.13), this is " + sys.version.split()[0] + "; give one with make PYTHON=...")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.demo: pyproject.toml $(VENV)/bin/python
	@echo "Installing Blender as a Python module and the evaluator (487 MB, once)"
	PYTHONWARNINGS=ignore $(RUN) -m pip install --disable-pip-version-check -c constraints/blender.txt -e ".[blender,evaluate]"
	touch $@

$(VENV)/.tests: pyproject.toml $(VENV)/.demo
	PYTHONWARNINGS=ignore $(RUN) -m pip install --disable-pip-version-check -c constraints/blender.txt -c constraints/tests.txt -e ".[blender,evaluate,networks,onnx,ephemeris,docs,develop]"
	touch $@

$(VENV)/.mutants: $(VENV)/.tests
	PYTHONWARNINGS=ignore $(RUN) -m pip install --disable-pip-version-check -e ".[mutants]"
	touch $@

# Only what the manual needs: no Blender.
$(VENV)/.docs: pyproject.toml $(VENV)/bin/python
	PYTHONWARNINGS=ignore $(RUN) -m pip install --disable-pip-version-check -e ".[evaluate,docs]"
	touch $@

clean:
	rm -rf $(VENV) .venvs .types dist build out *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
