# Every target makes what it needs in .venv; nothing else on the machine is touched.
PYTHON ?= python3
BOARD ?= pico
PORT ?=
ARGS ?=
BIN := .venv/bin
# Some tests wait, so there are three processes for two processors, see tests/conftest.py.
PARALLEL := --numprocesses auto --maxprocesses 4 --dist worksteal
FAST := tests/test_*.py tests/firmware tests/sim tests/referee
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

.PHONY: help demo test test-fast browser lint bench soak fuzz build flash erase doctor pictures paper clean
.DEFAULT_GOAL := help

help:
	@echo 'make demo   the virtual board, in a browser or here  ARGS="--seconds 5 --json"'
	@echo 'make test   every test                            ARGS="-k log2"'
	@echo 'make test-fast  the tests of arithmetic, simulator and structure, in half a minute'
	@echo 'make lint   style, format, docstrings and links'
	@echo 'make bench  driver, firmware and host compared with other projects'
	@echo 'make soak   hours of faults in simulated time    ARGS="--hours 1"'
	@echo 'make fuzz   bytes that break a parser         ARGS="decoder --seconds 60"'
	@echo 'make build  the files of a board, in build/BOARD  BOARD=pico'
	@echo 'make flash  the firmware onto a board, and start it  BOARD=pico PORT='
	@echo 'make erase  remove firmware, settings and calibration'
	@echo 'make doctor check a board, and print what to do'
	@echo 'make pictures  draw the pictures of the documents again'
	@echo 'make paper  measure the figures of docs/paper.md, fivebar.md, applications.md again'
	@echo 'make clean  remove .venv and all that was built'

demo: .venv/demo
	@$(BIN)/spots demo $(ARGS)

# Where an environment forbids compiled modules, every start of Python takes longer.
test test-fast: export PYTHONDONTWRITEBYTECODE =

test: .venv/test tests/wasm/node_modules browser
	@$(BIN)/python -m pytest $(PARALLEL) $(ARGS)

test-fast: .venv/test
	@$(BIN)/python -m pytest $(PARALLEL) $(FAST) $(ARGS)

browser: .venv/test
	@$(BIN)/python tests/web/bring_browser.py

lint: .venv/test
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/python -m pytest -p no:xdist tests/test_docstrings.py tests/test_links.py
	@$(BIN)/pyright

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

pictures: .venv/test browser
	@$(BIN)/python docs/make/pictures.py
	@$(BIN)/python docs/make/screenshots.py

paper: .venv/test
	@$(BIN)/python docs/make/paper.py docs
	@$(BIN)/python docs/make/linkage_page.py docs
	@$(BIN)/python docs/make/applications_page.py docs

clean:
	rm -rf .venv build dist tests/wasm/node_modules tests/web/browser/node_modules

.venv/demo: pyproject.toml
	@echo 'Setting up .venv (once) ...'
	@$(PYTHON) -m venv .venv
	@$(PIP) install --prefer-binary --editable '.[virtual,web]'
	@$(PIP) install --prefer-binary --editable '.[flash,export,zenoh]' || \
		echo 'Not every optional package exists for this machine; a command that needs one names it.'
	@touch $@

.venv/test: pyproject.toml
	@echo 'Setting up .venv for the tests (once) ...'
	@$(PYTHON) -m venv .venv
	@$(PIP) install --prefer-binary --editable '.[test]'
	@touch .venv/demo $@

.venv/fuzz: .venv/test
	@echo 'Setting up .venv for fuzzing (once) ...'
	@$(PIP) install --prefer-binary --editable '.[fuzz]'
	@touch $@

tests/wasm/node_modules: .venv/test tests/wasm/package.json tests/wasm/package-lock.json
	@PATH="$(CURDIR)/$(BIN):$$PATH" npm ci --prefix tests/wasm --no-audit --no-fund --loglevel error
	@touch $@
