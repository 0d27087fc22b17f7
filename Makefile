# Everything sets itself up: python3 (3.11 to 3.13) with its venv module (Debian: python3-venv), make and a package index
# are all that is needed. What is missing is said with the command that brings it.
PY := .venv/bin/python
STAMP := .venv/.installed
BENCH_STAMP := .venv/.bench-installed
BROWSER_STAMP := .venv/.browser-installed

.PHONY: demo test test-seeing test-wired test-systemd test-vm test-page types-page wheel check check-requirements lint types contract bench-vision bench-cycle landing nets test-fleet chaos-fleet load-fleet bench-fleet demo-fleet requirements clean

demo: $(STAMP)
	$(PY) -m daemon.cli demo $(DEMO_ARGS)

# In shares, two at a time: one computes on one core, the others mostly wait for wires. TEST_ARGS="-k bus" for less.
test: $(STAMP)
	@$(PY) -m tests.shares $(TEST_ARGS)

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

# The operator's page in a real browser. Needs Debian's package chromium; nothing is downloaded by the tests.
test-page: $(BROWSER_STAMP)
	REPROBE_TEST_PAGE=1 $(PY) -m pytest -q -rs tests/page $(PAGE_ARGS)

# The page's scripts by TypeScript's checker, which Deno brings; nothing is downloaded by it.
types-page: $(BROWSER_STAMP)
	DENO_NO_UPDATE_CHECK=1 .venv/bin/deno check --quiet --no-remote --no-npm --config tests/page/deno.json daemon/page/static/*.js

# Records of many stations through a real broker into a real database. Needs Debian's mosquitto and postgresql.
test-fleet: $(STAMP)
	REPROBE_TEST_FLEET=1 $(PY) -m pytest -q -rs tests/fleet $(FLEET_ARGS)

# Ten stations' records on the engines of a real centre, with questions and answers. Needs prometheus, too.
demo-fleet: $(STAMP)
	$(PY) -m tests.fleet.demo $(DEMO_ARGS)

# Ten thousand records over kills. FLEET_ARGS="--seeds 1" for one run; each kills something every 1.5 s.
chaos-fleet: $(STAMP)
	$(PY) -m tests.bench.fleet $(FLEET_ARGS)

# A thousand stations for a minute, and an hour's outage caught up. LOAD_ARGS="--connections 40 --outage 3600" for another.
load-fleet: $(STAMP)
	$(PY) -m tests.bench.fleet_load $(LOAD_ARGS)

bench-fleet: chaos-fleet load-fleet

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

# At real time: some ten minutes, most of them for setting the station up. CYCLE_ARGS="--rounds 4" for less.
bench-cycle: $(STAMP)
	$(PY) -m tests.bench.cycle $(CYCLE_ARGS)

# LANDING_ARGS="--trials 200 --stations 2" for less than everything.
landing: $(STAMP)
	$(PY) -m tests.bench.landing $(LANDING_ARGS)

# NETS_ARGS="--points 300" for less than everything.
nets: $(STAMP)
	$(PY) -m tests.bench.nets $(NETS_ARGS)

# An environment that broke after it was installed is noticed too: its stamp counts no longer.
ifneq ($(wildcard $(STAMP)),)
ifneq ($(shell $(PY) -c 'import sys, numpy; print((3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null),True)
$(shell rm -f $(STAMP) $(BENCH_STAMP) $(BROWSER_STAMP))
endif
endif

$(STAMP): requirements/dev.txt pyproject.toml
	@sh requirements/environment.sh .venv
	@echo "make: installing what $< lists into .venv; some minutes, depending on the network"
	@sh requirements/install.sh $(PY) --require-hashes -r requirements/dev.txt
	@sh requirements/install.sh $(PY) --no-deps --no-build-isolation -e .
	@touch $@

$(BENCH_STAMP): requirements/bench.txt $(STAMP)
	@echo "make: installing what $< lists into .venv"
	@sh requirements/install.sh $(PY) --require-hashes -r requirements/bench.txt
	@touch $@

$(BROWSER_STAMP): requirements/browser.txt $(STAMP)
	@echo "make: installing what $< lists into .venv"
	@sh requirements/install.sh $(PY) --require-hashes -r requirements/browser.txt
	@touch $@

# Run after changing the dependencies in pyproject.toml; commit the result.
UV_COMPILE := .venv/bin/uv pip compile -q --generate-hashes --python-version 3.11 --no-emit-index-url --no-annotate --no-header pyproject.toml
requirements: $(STAMP)
	$(UV_COMPILE) -o requirements/station.txt
	$(UV_COMPILE) --extra sim --extra page --extra fleet --extra dev -o requirements/dev.txt
	$(UV_COMPILE) --extra sim --constraint requirements/dev.txt -o requirements/sim.txt
	$(UV_COMPILE) --extra bench --constraint requirements/dev.txt -o requirements/bench.txt
	$(UV_COMPILE) --extra page --constraint requirements/dev.txt -o requirements/page.txt
	$(UV_COMPILE) --extra fleet --constraint requirements/dev.txt -o requirements/fleet.txt
	$(UV_COMPILE) --extra sim --extra page --extra fleet --extra dev --extra browser --constraint requirements/dev.txt -o requirements/browser.txt

# Are there wheels, with the hashes that are listed, for each Python and processor that is promised? Half a minute.
check-requirements: $(STAMP)
	@sh requirements/resolve.sh .venv/bin/uv

clean:
	rm -rf .venv out
