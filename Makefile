# Everything sets itself up: python3 (3.11 or newer), make and a package index are all that is needed.
PY := .venv/bin/python
STAMP := .venv/.installed
BENCH_STAMP := .venv/.bench-installed

.PHONY: demo test test-seeing test-wired test-systemd test-vm wheel check lint types contract bench-vision landing requirements clean

demo: $(STAMP)
	$(PY) -m daemon.cli demo $(DEMO_ARGS)

# Two halves side by side: one computes on one core, the other mostly waits for wires.
test: $(STAMP)
	@echo "Two halves side by side; each is shown when it is over, after some minutes."
	$(MAKE) --no-print-directory --jobs=2 --output-sync=line test-seeing test-wired

test-seeing: $(STAMP)
	$(PY) -m pytest -q tests/vision tests/daemon tests/sim_hw tests/bench

test-wired: $(STAMP)
	$(PY) -m pytest -q tests --ignore=tests/vision --ignore=tests/daemon --ignore=tests/sim_hw --ignore=tests/bench

# The unit under a real systemd, in namespaces. Needs root and mmdebstrap; the first time it builds a Debian tree in
# /var/cache/reprobe-tests (a minute or two), after that `make test` runs it too.
test-systemd: $(STAMP)
	REPROBE_TEST_SYSTEMD=build $(PY) -m pytest -q -rs -s tests/system

# The unit in an emulated machine with a kernel, udev and device nodes of its own. Needs qemu-system-x86, and the first
# time root and mmdebstrap, to build a disk in /var/cache/reprobe-tests; some ten minutes then, five later.
test-vm: $(STAMP)
	REPROBE_TEST_VM=build $(PY) -m pytest -q -rs -s tests/vm

# What is copied to a station, beside requirements/station.txt.
wheel: $(STAMP)
	.venv/bin/hatchling build -t wheel -d out/dist

lint: $(STAMP)
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .

types: $(STAMP)
	.venv/bin/mypy

contract: $(STAMP)
	.venv/bin/lint-imports

check: lint types contract test

# BENCH_ARGS="tip --scenes 200 --plots out/bench" for less than everything.
bench-vision: $(BENCH_STAMP)
	$(PY) -m tests.bench.vision $(BENCH_ARGS)

# LANDING_ARGS="--trials 200 --stations 2" for less than everything.
landing: $(STAMP)
	$(PY) -m tests.bench.landing $(LANDING_ARGS)

$(STAMP): requirements/dev.txt pyproject.toml
	test -x $(PY) || python3 -m venv .venv
	$(PY) -m pip install -q --disable-pip-version-check --require-hashes -r requirements/dev.txt
	$(PY) -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

$(BENCH_STAMP): requirements/bench.txt $(STAMP)
	$(PY) -m pip install -q --disable-pip-version-check --require-hashes -r requirements/bench.txt
	touch $@

# Run after changing the dependencies in pyproject.toml; commit the result.
UV_COMPILE := .venv/bin/uv pip compile -q --generate-hashes --python-version 3.11 --no-emit-index-url --no-annotate --no-header pyproject.toml
requirements: $(STAMP)
	$(UV_COMPILE) -o requirements/station.txt
	$(UV_COMPILE) --extra sim --extra dev -o requirements/dev.txt
	$(UV_COMPILE) --extra sim --constraint requirements/dev.txt -o requirements/sim.txt
	$(UV_COMPILE) --extra bench --constraint requirements/dev.txt -o requirements/bench.txt

clean:
	rm -rf .venv out
