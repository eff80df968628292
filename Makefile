# Two commands do everything on a fresh clone: `make demo` installs what it needs, `make test` adds the rest.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
NEWEST := .venv-newest
SCENE ?= scenes/flat_beam_arch.json
OUT ?= out/demo
# what is imported is compiled then, so that most of what is installed never is
PIP := --quiet --disable-pip-version-check --no-compile -c constraints.txt
# the matrices are small and the cores are for labellings: one BLAS thread per process
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
# where Python is told to keep no compiled files, each of the processes that tests begin compiles all it imports anew
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup browser types demo test newest check bench sanitize studies docs dist clean

setup: $(VENV)/.done

SOURCES := pyproject.toml setup.py constraints.txt $(wildcard src/jld_core/batch/source/*) src/jld_core/batch/build.py

# What runs jld: its libraries, and the batch solver in the best variant for this processor.
# The compiler works beside the installation: one waits for processors, the other for files.
$(VENV)/.runs: $(SOURCES)
	$(PYTHON) src/jld_core/batch/build.py --in-place --best & compiler=$$!; \
	$(PYTHON) -m venv $(VENV) && \
	JLD_COMPILED_APART=1 $(BIN)/python -m pip install $(PIP) -e '.[parquet]' || { kill $$compiler; exit 1; }; \
	wait $$compiler || echo "make: the batch solver was not compiled; without it searches take some 30 times as long"
	touch $@

# What tests, checks and documentation need besides, named one by one: to install jld again takes 3 s of a core. And the
# variant that the best one is compared with: each takes 25 s of a core, so those between them wait for `make bench`.
$(VENV)/.done: $(VENV)/.runs
	$(PYTHON) src/jld_core/batch/build.py --in-place --ends & compiler=$$!; \
	$(BIN)/python -c 'import tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
		print(*project["optional-dependencies"]["dev"], sep="\n")' >$(VENV)/dev.txt && \
	$(BIN)/python -m pip install $(PIP) -r $(VENV)/dev.txt || { kill $$compiler; exit 1; }; \
	wait $$compiler || echo "make: the batch solver was not compiled in its base variant"
	touch $@

demo: $(VENV)/.runs
	rm -rf $(OUT)
	$(BIN)/jld check $(SCENE)
	$(BIN)/jld explore $(SCENE) --out $(OUT)
	@echo "open $(OUT)/report.html"

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# mypy takes one core for a minute in a fresh clone, and the tests of pages wait for a browser most of the time: one after
# the other beside the tests, and all have to pass. In a fresh clone tests are collected once before they run, so that what
# they import is compiled once, themselves too: each of the processes that run them would do it again, 15 s of a core.
test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	{ $(BIN)/mypy && $(BIN)/python -m pytest -n 0 -m 'not long' tests/browser; } >$(VENV)/beside.txt 2>&1 & beside=$$!; \
	test -e $(VENV)/.collected || $(BIN)/python -m pytest -n 0 --collect-only -q >$(VENV)/.collected; \
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not long' --ignore tests/browser; tests=$$?; \
	wait $$beside; beside=$$?; cat $(VENV)/beside.txt; test $$tests -eq 0 -a $$beside -eq 0

# The newest version of every library, as `pip install .` takes without constraints, in an environment of its own, and
# the tests that touch most of them.
newest:
	$(PYTHON) src/jld_core/batch/build.py --in-place --best
	$(PYTHON) -m venv $(NEWEST)
	JLD_COMPILED_APART=1 $(NEWEST)/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
		--upgrade -e '.[parquet,reference]' pytest hypothesis
	$(NEWEST)/bin/python -m pytest -q tests/core/test_libraries.py tests/core/test_result_json.py \
		tests/core/test_bracket.py tests/validation/test_hard_cases.py tests/explore/test_enumeration.py \
		tests/explore/test_records.py

# the tests of pages use the system's Chromium, and skip where there is none
browser:
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null || { \
	  apt-get update -qq && \
	  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core; }

# the front end needs no build; this checks the types in its comments
types:
	npm exec --yes --package=typescript@5.9.3 -- tsc -p src/jld_views/assets/tsconfig.json

# without ecos, which has no wheel for every machine, the other solvers are compared
bench: setup
	-JLD_COMPILED_APART=1 $(BIN)/python -m pip install $(PIP) -e '.[dev,field]'
	$(PYTHON) src/jld_core/batch/build.py --in-place
	$(BIN)/python -m pytest -n 0 tests/core/test_batch_solver.py
	$(BIN)/python -m benchmarks
	JLD_KILLS=20 JLD_MUTATIONS=3000 $(BIN)/python -m pytest -n 0 -k 'random_kills or mutated_scenes' tests/conformance
	$(BIN)/python -m pytest -n 0 -m long --deselect tests/conformance/test_interruption.py::test_random_kills

# the batch solver under the sanitizers of the compiler: addresses and undefined behaviour, then data races of threads;
# libstdc++ is loaded with the first one, since Python itself throws no C++ exceptions
sanitize: setup
	$(BIN)/python src/jld_core/batch/build.py --sanitized out/sanitized
	LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libstdc++.so)" ASAN_OPTIONS=detect_leaks=0 \
		JLD_KERNEL=$(CURDIR)/out/sanitized/_base.so $(BIN)/python -m pytest -q -n 0 \
		tests/core/test_batch_solver.py tests/core/test_kernel_interface.py
	$(BIN)/python src/jld_core/batch/build.py --thread-sanitized out/sanitized/threads
	LD_PRELOAD=$$(gcc -print-file-name=libtsan.so) TSAN_OPTIONS="exitcode=66 report_signal_unsafe=0" \
		JLD_KERNEL=$(CURDIR)/out/sanitized/threads/_base.so $(BIN)/python -m tools.solver_threads

studies: setup
	$(BIN)/python -m studies

docs: setup
	$(BIN)/python -m tools.gallery
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs out/docs

# source archive, the wheel built from it, and both tried in a clean environment outside the checkout
dist: setup
	rm -rf dist
	$(BIN)/python -m build --outdir dist
	$(BIN)/python -m tools.try_wheel dist/*.whl

clean:
	rm -rf $(VENV) out build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
