# What a person types. Each target does its own set-up; nothing has to be installed by hand first.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
FIRMWARE := out/firmware
REPORTS := out/tests
BOOKWORM := out/bookworm
# Slow tests to which the clock does not matter, so that they can run behind those in real time:
# programs whose times nothing depends on, parsers, and a board in simulated time.
UNTIMED := tests/test_first_hour.py \
	$(patsubst %,tests/end_to_end/test_%.py,enrolled_robot gap_pictures printed_commands router \
	view_page who_may_talk) \
	tests/reliability/test_fuzz.py tests/reliability/test_serial_garbage.py \
	$(patsubst %,tests/firmware/test_%.py,deadman_firmware firmware_file motor_pins torn_frames)
# A test that hangs in spite of its timeout ends the run, and where it hangs is printed.
HUNG := --max-worker-restart 0 -o faulthandler_timeout=1200 -o faulthandler_exit_on_timeout=true
# With what is left of the processor: in a session of its own, as Linux shares time among sessions first
# (autogroup). Low priority within the timed tests' own session keeps time from threads of the kernel
# that carry a port's bytes: docs/safety.md, "A computer with other work".
IDLE := $(if $(shell command -v setsid),setsid sh -c '{ echo 19 > /proc/self/autogroup; } 2> /dev/null; \
	exec nice -n 19 "$$@"' sh,nice -n 19)
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

.DEFAULT_GOAL := help
.PHONY: help dist deb pins demo calibrate-demo demo-firmware test test-all test-bookworm test-pi test-kernel check size protocol firmware benchmark reliability reliability-quick policy-pages mutants mutants-all fuzz lock clean

help: ## Show this help
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	@echo "  Options of the demo: make demo DEMO='--panorama my-room.jpg --radius 2.5'"

demo: $(VENV)/.demo ## Drive a virtual robot with the real daemon; leaves pictures in out/demo
	$(BIN)/workstation demo --model models/red-cube.onnx $(DEMO)

calibrate-demo: $(VENV)/.all ## Rehearse the measuring of a robot on a virtual one; leaves out/calibrate-demo/gap.html
	$(BIN)/workstation calibrate demo $(DEMO)

demo-firmware: $(VENV)/.demo $(FIRMWARE)/mbot-deadman.elf ## The demo with the board's processor and firmware emulated
	@PYTHON=$(PYTHON) sh deploy/workstation-libraries.sh emulator
	$(BIN)/workstation demo --model models/red-cube.onnx --firmware $(FIRMWARE)/mbot-deadman.elf $(DEMO)

test: $(VENV)/.all ## Run the tests that a change needs, 5 minutes
	$(BIN)/pytest $(HUNG) -m "not slow" -n 2 --dist loadfile $(TEST)

test-all: $(VENV)/.all ## Run all tests: those too that run real programs in real time, 23 minutes
	@rm -rf $(REPORTS)
	$(BIN)/pytest $(HUNG) -m "not slow" -n 2 --dist loadfile --junitxml $(REPORTS)/quick.xml
	@mkdir -p $(REPORTS)
	@$(IDLE) $(BIN)/pytest $(HUNG) -m slow -n 2 --dist loadgroup --timeout 600 --junitxml $(REPORTS)/slow.xml tests/workstation $(UNTIMED) \
		> $(REPORTS)/slow.txt 2>&1 & untimed=$$!; \
	trap "kill -- -$$untimed 2> /dev/null || kill $$untimed" HUP INT TERM; \
	$(BIN)/pytest $(HUNG) -m slow --ignore tests/workstation $(UNTIMED:%=--ignore %) --junitxml $(REPORTS)/programs.xml; \
	timed=$$?; wait $$untimed; untimed=$$?; cat $(REPORTS)/slow.txt; test $$timed = 0 -a $$untimed = 0
	$(BIN)/python benchmarks/reliability.py --quick --of $(REPORTS) -o out/reliability.md

test-bookworm: $(BOOKWORM)/.there ## The daemon's quick tests beside numpy 1 and an older OpenCV, as on Raspberry Pi OS Bookworm; a minute
	PYTHONPATH=$(BOOKWORM) $(BIN)/pytest -m "not slow" -n 2 --dist loadfile tests/robot tests/protocol

$(BOOKWORM)/.there: $(VENV)/.all deploy/constraints-bookworm.txt
	@rm -rf $(BOOKWORM)
	$(PIP) install --no-deps --target $(BOOKWORM) -r deploy/constraints-bookworm.txt
	@touch $@

test-pi: $(VENV)/.all ## Install on booted Bookworm and Trixie machines and break things there, updates included; wants root, 30 minutes
	@PYTHON=$(PYTHON) sh deploy/workstation-libraries.sh machines
	$(BIN)/pytest tests/pi -v -n 0 --timeout 600 --ignore tests/pi/test_real_kernel.py --ignore tests/pi/test_arm64_kernel.py --junitxml out/tests-pi.xml

test-kernel: $(VENV)/.all ## The service on a kernel of its own, in an emulated PC: its limits, a plug pulled out, power cuts; a trial's on an arm64 one; wants root, 12 minutes
	@PYTHON=$(PYTHON) sh deploy/workstation-libraries.sh kernel
	$(BIN)/pytest tests/pi/test_real_kernel.py tests/pi/test_arm64_kernel.py -v -n 0 --timeout 900

check: $(VENV)/.all ## Lint, format, types, imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	PYTHONPATH= $(BIN)/lint-imports

size: ## Lines and modules of each room beside its budget; fails beyond one
	@$(PYTHON) benchmarks/size.py

protocol: $(VENV)/.all ## Generate the messages' Python code from the .proto file
	$(BIN)/python shared/protocol/generate.py

firmware: $(FIRMWARE)/mbot-deadman.hex ## Compile the board's firmware with a dead man's switch
	@avr-size --mcu=atmega328p --format=avr $(FIRMWARE)/mbot-deadman.elf | sed -n '/bytes/p'
	@echo "$<"

$(FIRMWARE)/mbot-deadman.elf: deploy/firmware/mbot-deadman.c
	@PYTHON=$(PYTHON) sh deploy/workstation-libraries.sh firmware
	@mkdir -p $(FIRMWARE)
	avr-gcc -mmcu=atmega328p -std=c11 -Os -Wall -Wextra -Werror -o $@ $<

$(FIRMWARE)/mbot-deadman.hex: $(FIRMWARE)/mbot-deadman.elf
	avr-objcopy -O ihex -R .eeprom $< $@

dist: $(VENV)/.all $(FIRMWARE)/mbot-deadman.hex ## Make wheel, sdist and signed releases for robots in out/dist; DIST='--sign-with KEY'
	$(BIN)/python -m mbot_workstation.fleet.releases.make_release $(DIST)

deb: $(VENV)/.all $(FIRMWARE)/mbot-deadman.hex ## As dist, and a Debian package of each release
	$(BIN)/python -m mbot_workstation.fleet.releases.make_release --deb $(DIST)

pins: $(VENV)/.all ## Resolve again which wheels a release has; writes deploy/requirements
	rm -rf deploy/requirements out/dist-cache
	$(BIN)/python -m mbot_workstation.fleet.releases.make_release --version 0 --sequence 0 --without-firmware $(DIST)
	$(PIP) download --only-binary=:all: -c constraints.txt --dest out/dist-cache/build hatchling
	$(BIN)/python -c 'from pathlib import Path; from mbot_workstation.fleet.releases.robot_wheels import requirement as pin; \
		print("# Wheels that build the daemon from a checkout. `make pins` writes it.", \
		*map(pin, sorted(Path("out/dist-cache/build").iterdir())), sep="\n")' > deploy/requirements/build.txt

benchmark: $(VENV)/.all ## Measure the daemon; use a quiet machine
	$(BIN)/python benchmarks/agent.py

reliability: $(VENV)/.all ## Cause every fault of the table, write docs/results/reliability.md; use a quiet machine
	$(BIN)/python benchmarks/reliability.py $(RELIABILITY)

reliability-quick: $(VENV)/.all ## Cause every fault of the table once, write the page; 10 minutes
	$(BIN)/python benchmarks/reliability.py --quick $(RELIABILITY)

policy-pages: $(VENV)/.all ## Make every page about the policy in models/ again, where it was stopped; about an hour
	$(BIN)/python benchmarks/policy_pages.py $(PAGES)

mutants: $(VENV)/.all ## Put small faults into what has changed of the safety path, one by one: a test must fail for each
	$(BIN)/python benchmarks/mutants.py --most 200 $(MUTANTS)

mutants-all: $(VENV)/.all ## All of them, in the firmware too; use a quiet machine, over an hour
	$(BIN)/python benchmarks/mutants.py --all $(MUTANTS)
	$(BIN)/python benchmarks/firmware_mutants.py

fuzz: $(VENV)/.all ## Feed every parser 100,000 inputs
	MBOT_FUZZ_CASES=100000 $(BIN)/pytest tests/reliability/test_fuzz.py tests/reliability/test_serial_garbage.py

lock: $(VENV)/.all ## Write the installed versions into constraints.txt
	$(BIN)/pip freeze --exclude-editable | sed 's/+cpu$$//' > constraints.txt

clean: ## Remove the virtual environment and what runs have left
	rm -rf $(VENV) out .pytest_cache .ruff_cache .hypothesis .import_linter_cache

$(VENV)/bin/python:
	@PYTHON=$(PYTHON) sh deploy/workstation-libraries.sh
	$(PYTHON) -m venv $(VENV)

$(VENV)/.demo: $(VENV)/bin/python pyproject.toml constraints.txt
	@PYTHON=$(PYTHON) sh deploy/workstation-libraries.sh
	$(PIP) install -c constraints.txt -e '.[robot,workstation,measure]'
	@touch $@

$(VENV)/.all: $(VENV)/bin/python pyproject.toml constraints.txt
	@PYTHON=$(PYTHON) sh deploy/workstation-libraries.sh test
	$(PIP) install -c constraints.txt -e '.[robot,workstation,measure,console,train,dev]'
	@touch $@ $(VENV)/.demo
