# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

# make test and make demo work in a fresh copy of this folder; make build is the quick way while developing. The Makefile
# in tools has the same for the tools.
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
PACKAGES := $(patsubst %/__init__.py,%,$(wildcard tf2_*/__init__.py))
SOURCES := pyproject.toml setup.py setup.cfg $(wildcard build_backend/*.py) \
	$(wildcard tf2_*/*.p[xy][dxi] tf2_*/*/*.p[xy][dxi] tf2_*/*.h)
MESSAGES_SOURCES := $(wildcard messages/*.* messages/backend/*.py messages/src/tf2_msgs/*/*.msg messages/src/tf2_msgs/*/*.srv) \
	$(wildcard messages/src/tf2_msgs/*/*.action)

# A Python that has the ROS wheels leaves this mark and its own library path to its children, and the Python of .venv
# would take it for its own and not find its libraries.
ifdef _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport LD_LIBRARY_PATH
endif

# With a sourced ROS 2, no second one is installed, and .venv exposes the system's packages, such as yaml.
ifdef AMENT_PREFIX_PATH
PROJECT := .
VENV_OPTIONS := --system-site-packages
VENV_KIND := sourced
VENV_OTHER := wheels
else
PROJECT := '.[ros]'
MESSAGES := $(VENV)/messages.stamp
VENV_OPTIONS :=
VENV_KIND := wheels
VENV_OTHER := sourced
endif
VENV_STAMP := $(VENV)/$(VENV_KIND).stamp

# Recreate .venv when a ROS 2 is newly sourced or no longer sourced.
ifneq ($(wildcard $(VENV)/$(VENV_OTHER).stamp),)
$(info Removing $(VENV), which was made for the other of sourced ROS 2 and ROS wheels)
$(shell rm -rf $(VENV))
endif

.PHONY: bare bench build clean coverage cross demo docs fuzz guard help lint matrix new oldest pictures prove release-check releases sanitize stress
.PHONY: test test-all test-core test-core-all test-core-long test-long wheels

define HELP
Try it
  make demo        watch a robot being broadcast and looked up
  make test        run the tests: 4 to 9 minutes on 2 cores
  make test-core TESTS=tests/ros/test_buffer.py
                   run some of them
Develop
  make build       compile after a change to a .pyx, .pxd, .pxi or .h file
  make lint        check style and types
  make test-all    run all tests: 15 to 25 minutes on 2 cores
  make test-long   run only what test-all adds to test
  make guard       count instructions; fail if they have changed
  make docs        build the site in build/docs
  make pictures    draw the pictures in docs/images again
  make clean       remove everything that these commands create
Measure, search for faults, release: CONTRIBUTING.md and docs/development describe
  make bench  coverage  fuzz  sanitize  stress  wheels  matrix  releases  oldest  cross  bare  prove  release-check
Each installs what it needs into $(VENV).
endef
export HELP

help:
	@echo "$$HELP"

# Three processes for each core, because tests wait for others half of their time; those of big machines would wait for
# each other. The tests of a file share what it makes; tests/support/suite_plugin.py orders the files. If a process
# dies, xdist would wait for ever instead of ending.
PYTEST = $(PY) -m pytest --numprocesses=$$((3 * $$(nproc))) --maxprocesses=8 --dist=loadfile \
	--no-loadscope-reorder --max-worker-restart=0
# One test may take that long.
LONGEST := -o faulthandler_timeout=7200

# First the core's, in an environment without what only the tools need, if that is new.
test: test-core
	$(MAKE) -C tools test

test-all: test-core-all
	$(MAKE) -C tools test-all

# TESTS: some of them, as `make test-core TESTS=tests/ros/test_buffer.py`.
test-core: $(VENV)/installed.stamp $(VENV)/test.stamp
	$(PYTEST) $(TESTS)

test-long: test-core-long
	$(MAKE) -C tools test-long

test-core-all: $(VENV)/installed.stamp $(VENV)/test.stamp $(VENV)/dev.stamp
	$(PYTEST) --all $(LONGEST) $(TESTS)

test-core-long: $(VENV)/installed.stamp $(VENV)/test.stamp $(VENV)/dev.stamp
	$(PYTEST) --long $(LONGEST) --durations=20 $(TESTS)

demo: $(VENV)/installed.stamp
	@$(PY) examples/demo.py

# QUICK=1: fewer sizes. The libraries compared with are fetched into .bench.
bench: $(VENV)/installed.stamp $(VENV)/test.stamp
	$(PY) -m bench $(if $(QUICK),--quick)

# The site of the pages in docs and tools/docs, and of the docstrings: build/docs/index.html.
docs: $(VENV)/docs.stamp $(VENV)/installed.stamp
	$(MAKE) -C tools installed
	$(PY) -m sphinx -E -W --keep-going -q -d build/doctrees -c docs . build/docs

# The pictures of docs/images and tools/docs/images, anew.
pictures: $(VENV)/installed.stamp
	$(MAKE) -C tools pictures

guard: $(VENV)/installed.stamp
	$(PY) -m bench.instruction_counts

# Long searches for faults, see docs/development/reliability.md. OPTIONS go to the program, as
# `make fuzz OPTIONS='cdr --seconds 60'`; `make fuzz OPTIONS=--help` names them.
fuzz sanitize: $(VENV)/dev.stamp $(VENV)/test.stamp
	$(MAKE) -C tools installed-all
	$(PY) -m reliability.$@ $(OPTIONS)

coverage: $(VENV)/dev.stamp $(VENV)/test.stamp
	$(PY) -m reliability.coverage $(OPTIONS)

stress: $(VENV)/installed.stamp
	$(PY) -m reliability.stress $(if $(MINUTES),--minutes $(MINUTES)) $(OPTIONS)

# docs/development/release.md tells what each of them does.
wheels: $(VENV)/dev.stamp
	$(PY) -m release.wheels $(OPTIONS)

matrix: $(VENV)/dev.stamp
	$(PY) -m release.wheels --all-pythons --ros jazzy kilted $(OPTIONS)

cross: $(VENV)/dev.stamp
	$(PY) -m release.cross_compile $(OPTIONS)

releases: $(VENV)/dev.stamp
	$(PY) -m release.rclpy_release_tests $(OPTIONS)

oldest: $(VENV)/dev.stamp
	$(PY) -m release.wheels --oldest $(OPTIONS)

release-check: $(VENV)/dev.stamp
	$(PY) -m release.release_check $(TAG)

# One commit, see docs/development/release.md. The steps run in a clone, which has an environment of its own.
prove:
	$(PYTHON) -m release.prove $(COMMIT)

# Without .venv: what it has must not be needed.
bare:
	$(PYTHON) release/readme_commands.py

# mypy reads the types of all that the packages may import.
lint: $(VENV)/dev.stamp $(VENV)/test.stamp
	$(MAKE) -C tools installed-all
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	PATH="$(CURDIR)/$(VENV)/bin:$$PATH" cython-lint $(PACKAGES)
	@echo "Compiling for Cython's performance hints: half a minute"
	$(PY) -m release.cython_hints $(PACKAGES)
	$(PY) -m mypy $(PACKAGES) tools/tf2_ros_tools
	$(PY) -m release.docstrings --check
	$(VENV)/bin/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(VENV)/bin/zizmor --offline --quiet .github
	$(VENV)/bin/reuse lint --lines

build: $(VENV)/test.stamp
	@$(PROGRESS); $(PY) setup.py -q build_ext --inplace
	touch $(VENV)/installed.stamp

clean:
	rm -rf $(VENV) .bench .cross .reliability build messages/build dist wheelhouse *.egg-info tools/build tools/*.egg-info messages/src/*.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find $(PACKAGES) messages tests tools build_backend -name '*.so' -delete -o -name '*.pyc' -delete
	cd messages/src/tf2_msgs && rm -f msg/*.py srv/*.py action/*.py _release.py
	rm -f tf2_ros_cython/_built.py

include step.mk

# The stamp comes last, because a step that failed or was interrupted leaves a Python without pip. Such an environment
# is completed, and one whose Python is gone is made anew.
$(VENV_STAMP): $(shell test -x $(PY) || echo new)
	@command -v $(PYTHON) > /dev/null || { echo "no $(PYTHON): install Python 3.10 or newer"; \
		echo "On Debian and Ubuntu: sudo apt install make g++ python3-dev python3-venv"; exit 1; }
	@$(PYTHON) build_backend/required_tools.py $(VENV_KIND)
	@mkdir -p $(VENV)
	$(call step,Creating $(VENV): some seconds,$(PYTHON) -m venv $(VENV_OPTIONS) $(VENV) && $(PY) -m pip install --upgrade pip)
	@touch $@

$(VENV)/messages.stamp: $(MESSAGES_SOURCES) | $(VENV_STAMP)
	$(call step,Installing ROS 2 Jazzy from PyPI$(comma) 240 MB$(comma) and compiling tf2_msgs: 1 to 2 minutes,$(PY) -m pip install --editable ./messages)
	@$(PY) -c "import rclpy.node" || { echo "ROS 2 in $(VENV) is incomplete, perhaps because its installation was interrupted:"; \
		echo "run make clean, and then the same command."; exit 1; }
	@touch $@

$(VENV)/installed.stamp: $(SOURCES) $(MESSAGES) | $(VENV_STAMP)
	$(call step,Compiling what has changed: at first up to 3 minutes on two cores,$(PY) -m pip install --editable $(PROJECT))
	@touch $@

$(VENV)/test.stamp: pyproject.toml
	@$(MAKE) -s $(VENV)/installed.stamp
	$(call step,Installing what the tests use$(comma) 40 MB: some seconds,$(PY) -m pip install 'tf2-ros-cython[test]')
	@touch $@

# Made anew only when the requirements change; pip finds the project installed and adds what the extra names.
dev_SIZE := up to 900 MB
docs_SIZE := 100 MB
$(foreach extra,dev docs,$(VENV)/$(extra).stamp): $(VENV)/%.stamp: pyproject.toml
	@$(MAKE) -s $(VENV)/installed.stamp
	$(call step,Installing the extra $*: $($*_SIZE),$(PY) -m pip install 'tf2-ros-cython[$*]')
	@touch $@
