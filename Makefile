# Every target makes what it needs in .venv; nothing else on the machine is touched.
PYTHON ?= python3
BOARD ?= pico
PORT ?=
ARGS ?=
BIN := .venv/bin
# Some tests wait, so there are more processes than processors, see tests/conftest.py.
PARALLEL := --numprocesses auto --maxprocesses 8 --dist worksteal
# The pure tests compute only; reading all test modules costs each process 4 s.
PURE := --numprocesses 2 --dist worksteal -m "not board and not browser"
MICROPYTHON := tests/wasm/node_modules/@micropython/micropython-webassembly-pyscript
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

OLD := SPOTS needs Python 3.10 or newer, and $(PYTHON) is %d.%d: install a newer one, and run make with PYTHON=python3.12, or its name
# Sets up an environment; one of an older Python, such as that of macOS, is replaced.
define VENV
@$(PYTHON) -c 'import sys; v = sys.version_info; v >= (3, 10) or sys.exit("$(OLD)" % tuple(v[:2]))'
@$(or $(1),.venv)/bin/python -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || rm -rf $(or $(1),.venv)
@$(PYTHON) -m venv $(or $(1),.venv)
endef

.PHONY: help demo test test-fast browser lint labs lab-lerobot lab-rerun bench soak fuzz release build flash erase doctor docs live pictures paper clean
.DEFAULT_GOAL := help

help:
	@echo 'make demo      the virtual board, in a browser or terminal               ARGS="--seconds 5 --json"'
	@echo 'make test      run all tests                                             ARGS="-k log2"'
	@echo 'make test-fast run the pure tests: no process, no browser; a minute if idle'
	@echo 'make lint      check style, format, docstrings, links and types'
	@echo 'make labs      test with LeRobot and Rerun, each in an environment of its own (9 GB)'
	@echo 'make bench     compare driver, firmware and host with other projects'
	@echo 'make soak      test with faults for hours of simulated time              ARGS="--hours 1"'
	@echo 'make fuzz      search for bytes that a parser fails on                   ARGS="decoder --seconds 60"'
	@echo 'make build     write the files of a board to build/BOARD                 BOARD=pico'
	@echo 'make flash     copy the firmware to a board, and start it                BOARD=pico PORT='
	@echo 'make erase     remove firmware, settings, calibration and layout         BOARD=pico PORT='
	@echo 'make doctor    check a board, and print a remedy for each problem        PORT='
	@echo 'make docs      build the site of the documents: build/site/index.html'
	@echo 'make live      build the live page: build/live/index.html, for any web server'
	@echo 'make pictures  draw pictures and screenshots of the documents again, and list the parts'
	@echo 'make paper     measure again, and write the pages in docs/evidence'
	@echo 'make release   write wheel, sdist, boards and hashes to dist             ARGS="dist --runtime pico=RPI_PICO.uf2"'
	@echo 'make clean     remove .venv and all built files'

demo: .venv/demo
	@$(BIN)/spots demo $(ARGS)

# Tests start Python often: let it store compiled modules, even if the environment forbids that.
test test-fast: export PYTHONDONTWRITEBYTECODE =
# NumPy starts 0.04 s faster without threads for linear algebra, whose matrices here are small.
test test-fast: export OPENBLAS_NUM_THREADS = 1

test: .venv/test tests/wasm/node_modules browser
	@$(BIN)/python -m pytest $(PARALLEL) $(ARGS)

test-fast: .venv/test
	@$(BIN)/python -m pytest $(PURE) $(ARGS)

browser: .venv/test
	@$(BIN)/python tests/support/bring_browser.py

lint: .venv/test tests/wasm/node_modules
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/python -m pytest -p no:xdist tests/test_docstrings.py tests/test_links.py
	@$(BIN)/pyright
	@$(BIN)/zizmor --offline --no-progress --quiet .github/workflows
	@PATH="$(CURDIR)/$(BIN):$$PATH" node tests/wasm/lint_workflows.mjs .github/workflows/*.yml

labs: lab-lerobot lab-rerun

# Each in its own environment, because their packages are large and exclude each other's versions.
lab-lerobot: build/labs/lerobot
	@$</bin/python -m pip --quiet install --no-deps --editable examples/lerobot_teleoperator_spots
	@$</bin/python -m pytest --noconftest -p no:cacheprovider tests/labs/lab_lerobot.py

lab-rerun: build/labs/rerun
	@$</bin/python -m pytest --noconftest -p no:cacheprovider tests/labs/lab_rerun.py

build/labs/lerobot:
	$(call VENV,$@)
	@$@/bin/python -m pip --quiet install 'lerobot>=0.4,<0.5' pandas pytest --editable '.[virtual,export,lerobot]'

build/labs/rerun:
	$(call VENV,$@)
	@$@/bin/python -m pip --quiet install pytest --editable '.[virtual,rerun]'

release: .venv/test live
	@$(BIN)/python tools/release.py --live build/live $(ARGS)

bench: .venv/test
	@$(BIN)/python tests/bench $(ARGS)

soak: .venv/test
	@$(BIN)/python tests/soak $(ARGS)

fuzz: .venv/fuzz
	@$(BIN)/python tests/fuzz $(ARGS)

build: .venv/demo
	@$(BIN)/spots build $(BOARD)

flash: .venv/demo
	@$(BIN)/spots flash $(BOARD) $(if $(PORT),--port $(PORT)) $(ARGS)

erase: .venv/demo
	@$(BIN)/spots erase $(BOARD) $(if $(PORT),--port $(PORT)) $(ARGS)

doctor: .venv/demo
	@$(BIN)/spots doctor $(if $(PORT),--port $(PORT))

docs: live
	@$(BIN)/python docs/make/build_site.py
	@rm -rf build/site/live && cp -R build/live build/site/live

live: .venv/docs tests/wasm/node_modules
	@$(BIN)/python -m spots_live.build build/live $(MICROPYTHON)

pictures: .venv/test browser live
	@PYTHONPATH=docs $(BIN)/python -m make.pictures
	@PYTHONPATH=docs $(BIN)/python -m make.timings
	@PYTHONPATH=docs $(BIN)/python -m make.press
	@PYTHONPATH=docs $(BIN)/python -m make.link_states
	@PYTHONPATH=docs $(BIN)/python -m make.parts_page
	@PYTHONPATH=docs $(BIN)/python -m make.battery_page
	@$(BIN)/python docs/make/screenshots.py
	@$(BIN)/python docs/make/clip.py

paper: .venv/test
	@$(BIN)/python docs/make/paper.py docs
	@$(BIN)/python docs/make/linkage_page.py docs
	@$(BIN)/python docs/make/applications_page.py docs
	@PYTHONPATH=tools $(BIN)/python docs/make/cheapest_page.py

clean:
	rm -rf .venv build dist tests/wasm/node_modules tests/web/browser/node_modules

.venv/demo: pyproject.toml
	@echo 'Setting up .venv (once) ...'
	$(call VENV)
	@$(PIP) install --prefer-binary --editable '.[virtual,web]'
	@$(PIP) install --prefer-binary --editable '.[flash,export,zenoh]' || \
		echo 'Not every optional package exists for this machine. A command that needs a missing one names it.'
	@touch $@

.venv/test: pyproject.toml
	@echo 'Setting up .venv for the tests (once) ...'
	$(call VENV)
	@$(PIP) install --prefer-binary --editable '.[test]'
	@touch .venv/demo .venv/docs $@

# Packages of `make docs` and `make live` alone, for a reader who tests nothing.
.venv/docs: pyproject.toml
	@echo 'Setting up .venv for the documents (once) ...'
	$(call VENV)
	@$(PIP) install --prefer-binary --editable '.[docs,virtual]'
	@touch $@

.venv/fuzz: .venv/test
	@echo 'Setting up .venv for fuzzing (once) ...'
	@$(PIP) install --prefer-binary --editable '.[fuzz]'
	@touch $@

tests/wasm/node_modules: .venv/docs tests/wasm/package.json tests/wasm/package-lock.json
	@PATH="$(CURDIR)/$(BIN):$$PATH" npm ci --prefix tests/wasm --no-audit --no-fund --loglevel error
	@touch $@
