# Fogbank's front door; `make help` lists the targets. Everything here is safe to run again: what is up to date is
# passed over.
PRESET ?= release
PREFIX ?= /usr/local
JOBS ?= $(shell nproc)

build_folder := build/$(PRESET)
python := .venv/bin/python
export FOGBANK_SERVER_BINARY := $(CURDIR)/$(build_folder)/bin/fogbankd

.DEFAULT_GOAL := help
.PHONY: help setup stubs build demo test test-faults test-farm test-deploy test-accuracy fuzz install bench evidence watch stability soak format lint lock clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/\1\t\2/p' $(MAKEFILE_LIST) | awk -F '\t' '{ printf "make %-13s %s\n", $$1, $$2 }'

setup: ## Debian packages and .venv, where anything is missing
	@deploy/setup.sh

stubs: setup
	@$(python) clients/python/generate_stubs.py

build: setup stubs ## the server (build/release/bin/fogbankd), its tests and the Python stubs; PRESET=release|dev|asan|tsan
	@test -f $(build_folder)/build.ninja || cmake --preset $(PRESET)
	@cmake --build --preset $(PRESET) --parallel $(JOBS)

demo: build ## render scenes/shafts through a local server into out/shafts.exr and out/shafts.png
	@mkdir -p out
	@.venv/bin/fogbank render scenes/shafts/shafts.xml --time 15 -o out/shafts.exr -o out/shafts.png

test: build ## build, then every test: C++ units, fuzz targets, Python (clients, service, oracle), lint
	@PRESET=$(PRESET) JOBS=$(JOBS) tests/run.sh

test-faults: build ## fault tests at full length: a table of test, figure, bound, verdict
	@cmake --preset fuzz >/dev/null
	@cmake --build --preset fuzz-all --parallel $(JOBS)
	@$(python) tests/faults/run.py

test-farm: build ## the farm's tests at full length: lost workers, restarts, slow links; a table of figures
	@$(python) -m pytest tests/farm -m "not soak"

fuzz: build ## fuzz targets for FUZZ_SECONDS (600) each: files, caches, checkpoints, requests; finds lie in out/fuzz
	@cmake --preset fuzz >/dev/null
	@cmake --build --preset fuzz-all --parallel $(JOBS)
	@$(python) tests/fuzz/run.py --seconds $(or $(FUZZ_SECONDS),600) --jobs $(JOBS)

test-deploy: build ## deploy/ in earnest: the Dockerfile's steps in a Debian of their own, a job in Slurm; ten minutes, as root; installs the tools
	@tests/deploy/install-tools.sh
	@$(python) -m pytest tests/deploy -m deployment --capture=no

test-accuracy: build ## pictures by the radiance cache with an error of 0.02, shared rooms, photon beams in all scenes; many minutes
	@$(python) -m pytest tests/oracle -m accuracy --capture=no

install: build ## link the fogbank command into PREFIX/bin (default /usr/local)
	@mkdir -p $(DESTDIR)$(PREFIX)/bin
	@ln -sfn $(CURDIR)/.venv/bin/fogbank $(DESTDIR)$(PREFIX)/bin/fogbank
	@echo "fogbank: linked as $(DESTDIR)$(PREFIX)/bin/fogbank"

bench: build ## the figures of the README: speed against Mitsuba 3, streaming, start-up
	@$(python) -m tests.bench.run

watch: build ## the short part of bench: figures that depend little on the machine, their history, and what got worse
	@$(python) -m tests.bench.run watch

evidence: build ## the README's comparison with other renderers: reports in out/evidence; BUDGETS=1,3 SEEDS=1 for a short one
	@$(python) -m tests.bench.evidence $(if $(BUDGETS),--budgets $(BUDGETS)) $(if $(SEEDS),--seeds $(SEEDS)) \
	  $(if $(REFERENCE),--reference $(REFERENCE)) $(if $(SCALE),--scale $(SCALE)) $(SCENES)

stability: build ## errors of the closed forms in stiff and extreme cases: tables and plots in out/stability
	@$(python) -m tests.stability.run

soak: build ## many clients that come, go and cancel, for FOGBANK_SOAK_SECONDS (600)
	@$(python) -m pytest tests -m soak --capture=no

format: setup ## reformat C++ and Python in place
	@git ls-files -z '*.cpp' '*.h' | xargs -0 --no-run-if-empty clang-format -i
	@.venv/bin/ruff check --quiet --fix-only .
	@.venv/bin/ruff format --quiet .

lint: build ## clang-format, clang-tidy, ruff, mypy and buf, without changing anything
	@PRESET=$(PRESET) JOBS=$(JOBS) tests/lint.sh

lock: setup ## pin the newest Python packages that pyproject.toml allows into deploy/python-packages.lock
	@build/uv/bin/uv pip compile --quiet --upgrade --universal --generate-hashes --custom-compile-command 'make lock' \
	  --python $(python) --extra figures --extra compare --extra farm --group build --group lint --group test \
	  --output-file deploy/python-packages.lock pyproject.toml

clean: ## remove what was built; .venv and the Debian packages stay
	@rm -rf build out clients/python/fogbank/_generated
