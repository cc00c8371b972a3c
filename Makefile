# Everything a newcomer or CI needs; the tools live in .venv and nothing else is touched.
#
#   make demo    UDR scoops a slice of cucumber, adaptsim adapts to it in two iterations, and both are compared
#   make test    the default tests (make test-long: those that take seconds each; make test-slow: an hour of them;
#                make test-lowest: with the oldest packages allowed; make test-newest: with the newest)
#
# Variables: PYTHON (3.11, 3.12 or 3.13), TORCH_INDEX (address of PyTorch's CPU wheel index, where pip finds no CPU wheel itself)

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
RUNS   := $(VENV)/.runs
# For training only. With its CUDA libraries where there is no CPU build; the locks hold everything else, so nothing is
# resolved again.
TORCH  := $(shell grep '^torch==' requirements.lock)
# Open3D loads the first three, Drake the fourth.
DEBIAN := libegl1 libgl1 libusb-1.0-0 libglib2.0-0

.PHONY: tosses results results-short setup demo test test-long test-slow test-extra test-lowest check format lock clean system docs site check-site check-live package test-newest
.DEFAULT_GOAL := setup

setup: $(STAMP)

# What the program runs with: enough for make demo, and less than half as large. Python compiles what it imports,
# 22 MB; pip would compile 118 MB.
$(RUNS): pyproject.toml requirements-run.lock
	@$(MAKE) --no-print-directory system
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 13) else f"adaptsim needs Python 3.11, 3.12 or 3.13, and $(PYTHON) is {v[0]}.{v[1]}: make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --no-deps --requirement requirements-run.lock
	$(BIN)/python -m pip install --quiet --no-deps --editable .
	@$(BIN)/python -c 'from perception.raycasting import load_open3d; load_open3d(); import pydrake' || { echo "The packages are installed but do not import: see above. System libraries needed: $(DEBIAN)"; exit 1; }
	@touch $@

# And the extras and tools of development.
$(STAMP): $(RUNS) requirements.lock
	$(BIN)/python -m pip install --quiet $(if $(TORCH_INDEX),--index-url $(TORCH_INDEX)) $(TORCH)
	$(BIN)/python -m pip install --quiet --no-deps --requirement requirements.lock
	@touch $@

system:
	@missing=""; for p in $(DEBIAN); do dpkg -s $$p >/dev/null 2>&1 || missing="$$missing $$p"; done; \
	$(PYTHON) -c 'import ensurepip' 2>/dev/null || missing="$$missing python3-venv"; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if ! command -v apt-get >/dev/null; then \
	  echo "This system has no apt-get. Install what these Debian packages hold, then run make again:$$missing" >&2; \
	elif [ "$$(id -u)" = 0 ]; then \
	  echo "Installing system packages:$$missing"; apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $$missing >/dev/null; \
	else \
	  echo "System packages are missing. Run this line, then make again:" >&2; echo "  sudo apt-get install -y$$missing" >&2; exit 1; \
	fi

# One particle for UDR: its policy is the same in every particle. The session ends when its verdict says so.
demo: $(RUNS)
	name=demo-$$(date +%Y%m%d-%H%M%S); lab="--task scooping --world cucumber --seed 0 --yes"; \
	ADAPTSIM_PARTICLES=1 $(BIN)/adaptsim run-iteration $$lab --method udr --session $$name-udr && \
	$(BIN)/adaptsim run-iteration $$lab --iterations 5 --until-done --session $$name && \
	$(BIN)/adaptsim compare $$name-udr $$name && \
	echo "UDR earns less than adaptsim here, because this turner has a blunt edge, and the default simulator a bevelled one. With the blunt" \
	"edge in the simulator (--object blunt-edge), little is left to adapt: docs/results/what-there-is-to-adapt.md"

# A test that hangs where no signal reaches it ends its process after this time, and the others go on.
HANGING := -o faulthandler_timeout=660 -o faulthandler_exit_on_timeout=true

test: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist worksteal --durations 10 $(HANGING)

test-long: $(STAMP)
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'long and not slow' --durations 10 $(HANGING)

test-slow: $(STAMP)
	$(BIN)/python -m pytest -n 2 -m slow --durations 10

# What the extras export, rerun, lerobot, realsense, wandb and mlflow read and write, with these programs themselves, and a session in Jupyter.
test-extra:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 12) else "LeRobot needs Python 3.12 or newer: make test-extra PYTHON=python3.12")'
	rm -rf .venv-extra && $(PYTHON) -m venv .venv-extra
	.venv-extra/bin/python -m pip install --quiet uv
	$(if $(TORCH_INDEX),.venv-extra/bin/python -m pip install --quiet --index-url $(TORCH_INDEX) 'torch<2.12' 'torchvision<0.27')
	.venv-extra/bin/uv pip install --quiet --no-config --python .venv-extra --editable '.[export,hdf5,mlflow,pandas,realsense,rerun,tensorboard,wandb]' 'lerobot[dataset]>=0.6,<0.7' ipykernel jsonschema nbclient pytest pytest-timeout
	.venv-extra/bin/python -m pytest -m extra tests/extras tests/hw/test_camera_realsense.py tests/contracts/test_camera_contract.py

# Every package that pyproject.toml names, at the lowest version that it allows; the two tests left out are about the locked ones.
test-lowest:
	rm -rf .venv-lowest && $(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/python -m pip install --quiet uv
	$(if $(TORCH_INDEX),.venv-lowest/bin/python -m pip install --quiet --index-url $(TORCH_INDEX) $(TORCH))
	.venv-lowest/bin/uv pip install --quiet --python .venv-lowest --resolution lowest-direct --editable '.[dev]'
	.venv-lowest/bin/python -m pytest -n 2 -m 'not slow and not hardware and not extra' \
	  --ignore tests/documents/test_generated_pages.py --deselect tests/e2e/test_package.py::test_it_holds_all_that_the_program_needs

# Every package at its newest version, so that a limit on a version is needed only where a test fails without it.
test-newest:
	rm -rf .venv-newest && $(PYTHON) -m venv .venv-newest
	.venv-newest/bin/python -m pip install --quiet uv
	$(if $(TORCH_INDEX),.venv-newest/bin/python -m pip install --quiet --index-url $(TORCH_INDEX) torch)
	.venv-newest/bin/uv pip install --quiet --python .venv-newest --resolution highest --editable '.[dev]'
	.venv-newest/bin/python -m pytest -n 2 -m 'not long and not slow and not hardware and not extra' \
	  --ignore tests/documents/test_generated_pages.py --ignore tests/e2e/test_package.py

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	! $(BIN)/vulture | grep -E 'unused (class|function|import|method|property)|unreachable code'

# Every method in every set of worlds, and the page that shows it: hours; stop it at any time, it goes on where it was.
# SCHEDULER=tcp://ADDRESS: on the workers of a Dask cluster (docs/guide/beyond-one-computer.md).
results: $(STAMP)
	$(BIN)/python benchmarks/results.py $(if $(SCHEDULER),--scheduler $(SCHEDULER))

# The same for the pendulum with a small budget: half a minute, nothing in docs/ changes.
results-short: $(STAMP)
	$(BIN)/python benchmarks/results.py --short

# The method judged by tosses that other people recorded (TOSSES=tosses.npz, docs/results/tosses.md); stop it at any time, it goes on where it was.
tosses: $(STAMP)
	@test -n "$(TOSSES)" || { echo "Name the file of the tosses: make tosses TOSSES=tosses.npz (docs/results/tosses.md says where it comes from)" >&2; exit 2; }
	PYTHONPATH=benchmarks/toss $(BIN)/python -m toss.experiment "$(TOSSES)" --page docs/results/tosses.md

# The pages of docs/ that follow from the code: commands, parameters, files, messages.
docs: $(STAMP)
	$(BIN)/python docs/generate.py

# The same Markdown as a site, in build/site; every link and anchor is checked.
site:
	$(PYTHON) -m venv .venv-site
	.venv-site/bin/python -m pip install --quiet --disable-pip-version-check 'mkdocs>=1.6,<2' 'mkdocstrings[python]>=1,<2'
	.venv-site/bin/mkdocs build --strict --quiet --site-dir build/site

# Lays out every page of the site as wide as a phone; needs Chromium or Chrome.
check-site: site
	$(PYTHON) docs/check_site.py build/site

# Opens live page, report and comparison in a browser while sessions run; pictures in build/live. Needs Chromium or Chrome.
check-live: $(STAMP)
	$(BIN)/python docs/check_live.py

# What a user gets: the wheel, installed in an empty environment and used outside of the checkout; its hash and its bill of materials.
package:
	rm -rf .venv-package .venv-build build/package && mkdir -p build/package
	$(PYTHON) -m venv .venv-build && $(PYTHON) -m venv .venv-package
	.venv-build/bin/python -m pip install --quiet --disable-pip-version-check 'build>=1.3' 'cyclonedx-bom>=7.2,<8'
	.venv-build/bin/python -m build --outdir build/package . >build/package/build.log || { tail build/package/build.log; exit 1; }
	.venv-package/bin/python -m pip install --quiet --disable-pip-version-check --constraint requirements.lock build/package/*.whl
	cd build/package && export ADAPTSIM_HOME=$$PWD/home PATH=$(CURDIR)/.venv-package/bin:$$PATH && \
	  adaptsim --version && python -m adaptsim_cli --help >/dev/null && adaptsim lab list && adaptsim doctor && \
	  adaptsim run-iteration --task pendulum --world wd --yes
	.venv-build/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --output-file build/package/sbom.cdx.json .venv-package/bin/python
	cd build/package && sha256sum *.tar.gz *.whl sbom.cdx.json > SHA256SUMS

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Write down exact versions for all three Pythons. What still fits stays; UPGRADE=--upgrade takes the newest.
# PyTorch stays (a CPU build of it must exist), and so do its CUDA libraries with it: both locks leave them out.
RESOLVE = .venv-lock/bin/uv pip compile --quiet --universal --python-version 3.11 --no-annotate --no-header $(UPGRADE)
SHORTEN = sed -E -e '/^(cuda-|nvidia-|triton)/d' -e "s/ and platform_machine == 'x86_64'//; s/ and platform_python_implementation != 'PyPy'//; s/ and sys_platform == 'linux'//" \
  -e "s/ ; python_full_version < '3.14'$$//; s/ and python_full_version < '3.14'$$//"
lock:
	rm -rf .venv-lock && $(PYTHON) -m venv .venv-lock
	.venv-lock/bin/python -m pip install --quiet uv
	cp requirements.lock .venv-lock/all.txt && echo '$(TORCH)' > .venv-lock/torch.txt
	$(RESOLVE) --extra dev --constraint .venv-lock/torch.txt --output-file .venv-lock/all.txt pyproject.toml
	{ echo "# Exact versions of everything, for Python 3.11 to 3.13 on Linux x86-64. Made by make lock."; $(SHORTEN) .venv-lock/all.txt; } > requirements.lock
	$(RESOLVE) --constraint requirements.lock --output-file .venv-lock/run.txt pyproject.toml
	{ echo "# Exact versions of what the program runs with, a part of requirements.lock: no tools, no extras. Made by make lock."; $(SHORTEN) .venv-lock/run.txt; } > requirements-run.lock
	rm -rf .venv-lock

clean:
	rm -rf $(VENV) .venv-lock .venv-lowest .venv-newest .venv-site .venv-package .venv-build .venv-extra build *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
