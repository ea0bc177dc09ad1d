# `make demo` and `make test` need nothing but Python >= 3.11, git and make.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# What the product has on a laptop (requirements.lock), and what its tests need as well (requirements-dev.lock).
RUNTIME := $(VENV)/.runtime
READY := $(VENV)/.ready
# A bare Debian has no lists of packages yet.
APT_INSTALL := apt-get update -qq && apt-get -o DPkg::Lock::Timeout=600 install -qq --yes

# Without bytecode every Python that is started compiles the project and its libraries anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-kernel test-mesh test-long test-plain test-slow test-docker test-interop test-conformance \
	test-ros2 test-vda5050 test-world test-environments test-soak tolerance lint check-lock lock drills test-browser screenshots \
	coverage clean verify-recordings

help:
	@echo "make demo            six robot processes repair a vehicle, live in this terminal"
	@echo "make setup           .venv with everything from requirements-dev.lock, as the others do first"
	@echo "make test            checks and tests, in about five minutes on two idle cores"
	@echo "make gate            every suite in the larger size, as .ci/run after make test; SUITES=browser: some"
	@echo "make lint            ruff, mypy, import-linter"
	@echo "make coverage        how much of the code the fast tests enter"
	@echo "make docs            the documentation as a site, in build/site"
	@echo "make reference       write the reference of commands and of the Python API anew"
	@echo "make test-kernel     the kernel's tests where features and the periphery are deleted"
	@echo "make test-mesh       the mesh's own tests where analysis, views, adapters and btcpp are deleted"
	@echo "make test-browser    the live page in headless Chromium; as root, installs Debian's if missing"
	@echo "make test-docker     the docker-compose demo; as root, installs Debian's docker.io if missing"
	@echo "make test-interop    other programs judge: BehaviorTree.CPP, an open monitor, Foxglove's protocol"
	@echo "make test-ros2       robots of ROS 2: rclpy's action servers, in a .venv-ros2 that is made once"
	@echo "make test-vda5050    AGVs: mosquitto and npm's virtual vehicles; as root, installs Debian's if missing"
	@echo "make test-world      the workshop with bodies: MuJoCo, the mission in virtual time, a drill"
	@echo "make test-soak       a team of real processes for ten minutes: no errors, and nothing grows"
	@echo "make drills          all drills on real processes; as root on Linux those with bad networks too"
	@echo "make lock            write both lock files again from pyproject.toml"
	@echo "make clean           remove .venv and caches"
	@echo "More tests: CONTRIBUTING.md. Measurements: python -m benchmarks --help"

setup: $(READY)

$(RUNTIME): requirements.lock pyproject.toml deploy/make-venv deploy/install_locked.py
	@PYTHON=$(PYTHON) sh deploy/make-venv $(VENV)
	@$(BIN)/python deploy/install_locked.py requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $(RUNTIME)

$(READY): $(RUNTIME) requirements-dev.lock
	@$(BIN)/python deploy/install_locked.py requirements-dev.lock
	@touch $(READY)

demo: $(RUNTIME)
	$(BIN)/mrbt demo

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The site in build/site; fails for links that lead nowhere.
.PHONY: docs
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

# The pages of commands and of the Python API, from their help and docstrings.
.PHONY: reference
reference: $(READY)
	$(BIN)/python -m tests.support.reference_pages

# What is tried (tests/support/effort.py) is what fits into five minutes on two idle cores.
test: $(READY)
	@echo "about five minutes on two idle cores: checks and real processes, then all other tests"
	@$(MAKE) --no-print-directory --jobs 3 --output-sync=target checks smoke
	$(BIN)/pytest -n auto --dist worksteal -m "not processes and not slow"

# Teams of real processes wait half of the time, and come before what only computes.
.PHONY: checks smoke
checks:
	@nice -n 10 $(MAKE) --no-print-directory lint docs

smoke: $(READY)
	$(BIN)/pytest -n 3 -m "smoke and not slow" tests/processes

# tests/structure/test_wall.py runs some of them.
test-kernel: $(READY)
	$(BIN)/pytest -m "slow or not slow" tests/structure/test_rooms.py

test-mesh: $(READY)
	$(BIN)/python -m tests.support.mesh_alone

# The same with more seeds and more examples of every property.
test-long: $(READY)
	MRBT_TESTS=long $(BIN)/pytest -n auto -m "not processes"

# What robots compute with must make no difference: everything by the plain definitions.
test-plain: $(READY)
	MRBT_PLAIN=1 MRBT_TESTS=gate $(BIN)/pytest -n auto -m "not processes"

test-slow: $(READY)
	$(BIN)/pytest -m slow

coverage: $(READY)
	$(BIN)/coverage erase
	$(BIN)/pytest -n auto --cov=mrbt_mesh --cov-report= -m "not processes and not slow"
	$(BIN)/coverage report --sort=cover

# What mrbt analyze foretells of faults against simulated runs: some 6,200 of them, ten minutes.
tolerance: $(READY)
	MRBT_TESTS=long $(BIN)/pytest -n auto tests/analysis/tolerance/test_fault_counts_random_missions.py

test-browser: $(READY) chromium
	$(BIN)/pytest -n 2 -m browser tests/browser

screenshots: $(READY) chromium
	@command -v tmux > /dev/null || { $(APT_INSTALL) tmux; } || \
		{ echo "install tmux, or run this as root on Debian"; exit 1; }
	$(BIN)/python -m benchmarks.page pictures build/pictures
	cp build/pictures/dead-1440x900-light.png docs/web/page-light.png
	cp build/pictures/dead-1440x900-dark.png docs/web/page-dark.png
	$(BIN)/python -m benchmarks.page animation docs/kill.gif

.PHONY: chromium
chromium:
	@command -v chromium chromium-browser google-chrome > /dev/null || { $(APT_INSTALL) chromium; } || \
		{ echo "install chromium, or run this as root on Debian"; exit 1; }

test-docker: $(READY)
	$(BIN)/pytest tests/docker

# BehaviorTree.CPP and the like are not in requirements-dev.lock: they have no wheels for every machine.
.PHONY: parts-interop parts-vda5050 parts-ros2 parts-world
parts-interop: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation -e '.[interop]'

INTEROP_TESTS := tests/adapters tests/processes/test_foxglove.py tests/btcpp/executor/test_tree_with_others.py \
	tests/btcpp/files/test_*_as_the_library.py tests/analysis/test_*_as_the_library.py

test-interop: parts-interop
	$(BIN)/pytest $(INTEROP_TESTS)

# 2,602 traces and 8,000 scripts measured with BehaviorTree.CPP 4.10; `make test` has an eighth.
test-conformance: $(READY)
	MRBT_TESTS=gate $(BIN)/pytest tests/btcpp/executor/test_tree_executor_traces.py \
		tests/btcpp/scripts/test_evaluator_measured.py tests/analysis/test_team_tree_traces.py

# Parts that others have made: a broker, virtual AGVs, published schemas (docs/how-to/vda5050.md).
VDA5050_NODE := $(VENV)/vda5050
parts-vda5050: $(READY)
	@command -v mosquitto > /dev/null || { $(APT_INSTALL) mosquitto; } || \
		{ echo "install mosquitto, or run this as root on Debian"; exit 1; }
	@command -v npm > /dev/null || { $(APT_INSTALL) npm; } || \
		{ echo "install node and npm, or run this as root on Debian"; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation -e '.[vda5050]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps vda5050-sdk==0.2.0
	npm install --silent --prefix $(VDA5050_NODE) vda-5050-lib@1.4.0

test-vda5050: parts-vda5050
	MRBT_VDA5050_NODE=$(abspath $(VDA5050_NODE)) $(BIN)/pytest tests/adapters/vda5050 \
		tests/processes/test_vda5050.py tests/docker/test_compose_agvs.py

# rclpy has a virtual environment of its own: its wheels start every Python of theirs anew.
ROS2 := .venv-ros2
parts-ros2: $(READY)
	PYTHON=$(abspath $(BIN))/python sh tests/support/ros2/make-ros2 $(ROS2)

test-ros2: parts-ros2
	MRBT_ROS2_PYTHON=$(abspath $(ROS2))/bin/python $(BIN)/pytest tests/adapters/ros2 \
		tests/processes/test_ros2.py

# The workshop with bodies (docs/how-to/workshop.md): eight minutes.
parts-world: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation -e '.[world]'

test-world: parts-world
	$(BIN)/pytest tests/examples/workshop tests/processes/test_workshop.py

# What the suites of the gate need beyond requirements-dev.lock. What cannot be had here is said, and
# the tests that need it are skipped with the reason.
PARTS := parts-interop parts-vda5050 parts-ros2 parts-world chromium locales networks prometheus proxy
.PHONY: gate parts locales networks prometheus proxy
locales:
	@command -v localedef > /dev/null && test -e /usr/share/i18n/locales/en_US || { $(APT_INSTALL) locales; } || \
		{ echo "install locales, or run this as root on Debian"; exit 1; }

networks:
	@{ command -v ip && command -v iptables-restore; } > /dev/null || { $(APT_INSTALL) iproute2 iptables; } || \
		{ echo "install iproute2 and iptables, or run this as root on Debian"; exit 1; }

proxy:
	@PATH=$$PATH:/usr/sbin; command -v nginx > /dev/null || { $(APT_INSTALL) --no-install-recommends nginx-light; } || \
		{ echo "install nginx, or run this as root on Debian"; exit 1; }

prometheus:
	@command -v promtool > /dev/null || { $(APT_INSTALL) --no-install-recommends prometheus; } || \
		{ echo "install prometheus, or run this as root on Debian"; exit 1; }

parts: $(READY)
	@for part in $(PARTS); do echo "preparing: $$part"; \
		$(MAKE) --no-print-directory --silent $$part || echo "CANNOT BE HAD HERE: $$part"; done

# Every suite in the larger size, but for what make test runs just so: tests/support/gate.py. About
# 35 minutes.
gate: parts
	MRBT_VDA5050_NODE=$(abspath $(VDA5050_NODE)) \
		MRBT_ROS2_PYTHON=$$(test -e $(ROS2)/.ready && echo $(abspath $(ROS2))/bin/python) \
		$(BIN)/python -m tests.support.gate $(SUITES)

test-environments: $(READY) locales
	$(BIN)/pytest -n 2 --dist loadgroup tests/environments

drills: $(READY)
	$(BIN)/mrbt drill --all --brief --junit drills.xml

# Recordings of honest runs, proved; falsified ones, found; and what-if with nothing changed.
verify-recordings: $(READY)
	MRBT_TESTS=long $(BIN)/pytest -n auto tests/views/replay/test_what_if_unchanged.py
	MRBT_TESTS=long $(BIN)/pytest -n auto tests/views/replay/test_verify.py -k random_falsifications
	$(BIN)/python -m benchmarks.verified_recordings
	$(BIN)/python -m benchmarks.forged_recordings
	$(BIN)/python -m benchmarks.honest_recordings

test-soak: $(READY)
	MRBT_TESTS=gate $(BIN)/pytest -n 2 tests/processes/test_soak.py tests/sim/test_run_soak.py

LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate \
	--no-header --no-emit-index-url pyproject.toml
# A laptop's, and what the image of robots has as well (deploy/Dockerfile).
RUNTIME_EXTRAS := --extra all --extra build --extra vda5050

.PHONY: uv
uv: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv

lock: uv
	$(LOCK) --upgrade --extra dev -o requirements-dev.lock
	$(LOCK) --upgrade $(RUNTIME_EXTRAS) -c requirements-dev.lock -o requirements.lock

# Both lock files have what pyproject.toml asks for, in the same versions.
check-lock: uv
	@mkdir -p build && cp requirements.lock requirements-dev.lock build
	$(LOCK) --extra dev -o build/requirements-dev.lock
	$(LOCK) $(RUNTIME_EXTRAS) -c requirements-dev.lock -o build/requirements.lock
	diff requirements-dev.lock build/requirements-dev.lock && diff requirements.lock build/requirements.lock

clean:
	rm -rf $(VENV) $(ROS2) .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
