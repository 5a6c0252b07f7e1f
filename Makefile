# padgen: make pad, make test; `make help` lists the rest.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
CORES = $(shell env -u OMP_NUM_THREADS -u OMP_THREAD_LIMIT nproc 2>/dev/null || getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
TEMPLATES := $(basename $(notdir $(wildcard templates/*.toml)))

.DEFAULT_GOAL := help
.PHONY: help setup pad test soak hostile odd board-drc check format variants slice bundle goldens performance selectivity accuracy waveforms docs pictures lock sbom wheels clean $(TEMPLATES:%=variant-%)

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

# uv installs the lock in a third of pip's time. pip installs it where its settings, which uv does not read, name another
# registry, and where uv does not reach one. Neither takes an editable install together with hashes; that step needs no
# network: setuptools is in the lock.
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check
UV = ! $(BIN)/python -m pip config list | grep '[.]index-url=' > /dev/null && \
  VIRTUAL_ENV=$(VENV) $(BIN)/uv pip install --quiet --system-certs --compile-bytecode
$(STAMP): pyproject.toml setup.py requirements.lock
	$(PYTHON) -m venv $(VENV)
	awk '/^[^ ]/ { is_uv = /^uv==/ } is_uv' requirements.lock > $(VENV)/uv.lock
	$(PIP) --require-hashes --requirement $(VENV)/uv.lock
	@{ $(UV) --require-hashes --requirement requirements.lock 2> /dev/null; } || \
	  { echo "pip installs it, since its settings name a registry or uv reaches none: this takes some minutes"; \
	    $(PIP) --require-hashes --requirement requirements.lock; }
	$(PIP) --no-deps --no-build-isolation --no-index --editable .
	@touch $@

setup: $(STAMP) ## make the environment in .venv, every extra included

pad: $(STAMP) ## a 32-taxel pad that prints, into out/pad-32
	$(BIN)/padgen plan pad-32
	$(BIN)/padgen build pad-32

# One process more than cores, since some tests wait for others' processes. Compiled first, since tests start hundreds of
# processes, and none of them would keep what it compiles where PYTHONDONTWRITEBYTECODE is set.
test: $(STAMP) ## the whole test suite (compilers and chromium, which some need, come from Debian if missing)
	@{ command -v $${CC:-cc} && command -v $${CXX:-c++}; } >/dev/null || \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends gcc g++ libc6-dev; }
	@{ command -v chromium || command -v chromium-browser || command -v google-chrome; } >/dev/null || \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium; }
	@$(BIN)/python -m compileall -q padgen tests
	$(BIN)/python -m pytest -n $$(($(CORES) + 1)) --dist loadfile --no-loadscope-reorder

soak: $(STAMP) ## random bytes for the firmware, random specs, and the samples and scenes that make test leaves out (hours)
	$(BIN)/python -m pytest -m soak

hostile: $(STAMP) ## a thousand folders as strangers may send them, fifty under strace (installed from Debian if missing; an hour)
	@command -v strace >/dev/null || { apt-get update -qq && apt-get install -y -qq --no-install-recommends strace; }
	$(BIN)/python -m pytest -m hostile -o faulthandler_timeout=3600 -n $(CORES) tests/core/test_hostile_folders.py

odd: $(STAMP) ## plan 20,000 odd specs, fields anywhere within their bounds, and print faults (SPECS=N for fewer; hours)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/measure_odd.py $(SPECS)

check: $(STAMP) ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --follow-imports=silent docs/*.py

format: $(STAMP) ## put the style right
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Sweeps take -j as make was given it, where make tells the number (4.2 and later), else all cores; JOBS=N always holds.
JOBS = $(patsubst -j%,%,$(filter -j%,$(MAKEFLAGS)))

variants: $(STAMP) ## every template into out/, or SWEEP=file.toml; only what changed, in parallel (-j N)
ifdef SWEEP
	$(BIN)/padgen sweep "$(SWEEP)" $(addprefix -j ,$(JOBS))
else
	+@$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j $(or $(JOBS),$(CORES))) $(TEMPLATES:%=variant-%)
endif

$(TEMPLATES:%=variant-%): variant-%: $(STAMP)
	$(BIN)/padgen build $*

slice: $(STAMP) ## slice every template and ten odd pads with PrusaSlicer (installed from Debian if missing) and measure them
	@{ command -v prusa-slicer && command -v slic3r; } >/dev/null || \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends prusa-slicer slic3r; }
	$(BIN)/python -m pytest -m slicer tests/sliced/test_slicer.py

board-drc: $(STAMP) ## KiCad's rules over boards of coils and broken ones, resistances by pictures of gerbv (both from Debian) and gerbonara
	@{ /usr/bin/python3 -c "import pcbnew" && command -v gerbv; } >/dev/null 2>&1 || \
	  { apt-get update -qq && apt-get install -y -qq --no-install-recommends kicad gerbv; }
	$(PIP) --constraint constraints.txt gerbonara==1.5.0
	$(BIN)/python -m pytest -m kicad -o faulthandler_timeout=3600 tests/solid/test_board_files.py

PAGE := padgen/report/page

bundle: ## remake the report page's scripts from their sources (needs npm; installing padgen does not)
	@set -e; aside=$$(mktemp -d); trap 'rm -rf "$$aside"' EXIT; cp $(PAGE)/package*.json "$$aside"; \
	  npm ci --prefix "$$aside" --ignore-scripts --no-audit --no-fund --silent; modules="$$aside/node_modules"; \
	  for name in three uplot; do printf '%s\n\n' "$$name"; cat "$$modules/$$name/LICENSE"; echo; done > $(PAGE)/LICENSES; \
	  bundled() { NODE_PATH="$$modules" "$$modules/.bin/esbuild" "$$@" --bundle --minify --charset=utf8 --log-level=warning; }; \
	  { printf '/*!\n'; cat $(PAGE)/LICENSES; printf '*/\n'; \
	    bundled $(PAGE)/main.js --format=iife --target=es2022 --legal-comments=none; } > $(PAGE)/page.min.js; \
	  bundled $(PAGE)/page.css > $(PAGE)/page.min.css; \
	  cd $(PAGE) && LC_ALL=C sha256sum $$(ls | grep -v -e SHA256SUMS -e page.html) > SHA256SUMS

goldens: $(STAMP) ## write the golden texts anew, after a wanted change of geometry or of a file's first line
	$(BIN)/python -m pytest tests/project/test_templates.py tests/project/test_docs.py -k "golden or every_file" --regenerate

performance: $(STAMP) ## measure what docs/performance.md reports
	$(BIN)/python docs/measure.py

selectivity: $(STAMP) ## compute what docs/selectivity.md reports
	OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/measure_selectivity.py

accuracy: $(STAMP) ## compute what docs/accuracy.md and docs/dynamics.md report (half an hour)
	for part in campaign beams elasticity loop force pad left_out dynamics stretching; do \
	  OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/measure_$$part.py || exit 1; done
	$(BIN)/padgen study paper-32
	$(BIN)/padgen study --extreme

waveforms: $(STAMP) ## measure what docs/waveforms.md and docs/retune.md report (an hour)
	for part in waveforms.py ear.py retune.py "retune.py recordings" "retune.py loop" "retune.py eye"; do \
	  OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/measure_$$part || exit 1; done
	$(BIN)/python docs/draw_waveforms.py

docs: $(STAMP) ## the documentation site, into out/docs (a warning is an error)
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d out/.doctrees docs out/docs
	@echo out/docs/index.html

pictures: $(STAMP) ## draw the README's pictures anew, and what docs/yield.md says of capacity
	$(BIN)/python docs/pictures.py
	OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/draw_capacity.py

# For every Python from 3.11 and every platform, by markers; names, versions and hashes only.
lock: $(STAMP) ## make requirements.lock anew, after a change of constraints.txt or of a dependency
	rm -f $(VENV)/requirements.lock
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --all-extras --generate-hashes --no-annotate \
	  --no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" \
	  --constraint constraints.txt --output-file $(VENV)/requirements.lock pyproject.toml > /dev/null
	mv $(VENV)/requirements.lock .

sbom: $(STAMP) ## the bill of materials (CycloneDX) of padgen and what it needs, into out/sbom.json
	$(BIN)/python docs/supply.py sbom out/sbom.json

wheels: $(STAMP) ## plan by the wheel under Python 3.11, 3.12 and 3.13, as far as they are here, and compare
	$(BIN)/python docs/supply.py wheels

clean: ## remove generated files, the environment too
	rm -rf out $(VENV)
