# The commands that people type. Each sets up what it needs.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
SCENARIO ?= rough_turning
STEPS ?=
NUM_SEEDS ?= 256
TASK_SEEDS ?= 64
SPLIT_SEEDS ?= 32
OTHER_PYTHON ?=
CLIENTS ?=
RUNS ?= runs
RESULTS ?= results
SHIPPED ?= agents
SHIPPED_RESULTS ?= leaderboard/results
JOBS ?= 2
WORKERS ?= 2
ENVS ?= RoughTurning-v0 RoughTurning-Paper-v0 RoughTurning-Override-v1 RoughTurning-Surface-v1 RoughTurning-Shift-v0 RoughTurning-Batch-v0 \
	RoughTurning-Family-v1
# Policies of the family's boards that do not machine sensibly.
DEGENERATE = $$(.venv/bin/python -c "from baselines.trivial import DEGENERATE; print(*DEGENERATE)")
# A sixth of the steps of agents that ship, for a first look.
TRAIN = .venv/bin/python -m train.ppo --scenario $(SCENARIO) --runs $(RUNS)/first --steps $(or $(STEPS),1000000)
RUN = .venv/bin/python -m leaderboard run --scenario $(SCENARIO) --seeds $(NUM_SEEDS) --results $(RESULTS)
PYTEST = .venv/bin/pytest -n $(WORKERS) --dist worksteal $(if $(DURATIONS),--durations $(DURATIONS))

# Extras by set-up: `make leaderboard` and the like need the first, tests, examples and the site also the second.
RUN_EXTRAS = benchmark
TEST_EXTRAS = distributed render ecosystem docs programs opcua xlsx publish test
PIP = .venv/bin/python -m pip --disable-pip-version-check
UV = .venv/bin/uv pip install --quiet --python .venv/bin/python
# Wheels only, compared with the hashes of packaging/constraints.txt. Torch comes from a folder of wheels if pip's settings name one with a build without
# CUDA, a tenth of the download.
INSTALL = UV_FIND_LINKS=$$($(PIP) config get global.find-links 2> /dev/null) $(UV) --only-binary :all: -c packaging/constraints.txt
# The requirements of both distributions and of their extras. Given the folders themselves instead, uv would build them.
install = .venv/bin/python tools/requirements.py $(1) | $(INSTALL) -r -

# Cards of the agents that ship, which say how each was trained.
CARDS ?= $(wildcard agents/*/*/*.md)
SEEDS ?= 0-9
# The commit that holds the agents of all training seeds.
ALL_SEEDS ?= c9f5181152a654923538df1080ee329eec4ee721

# Processors that `make processors` imitates: kernels of OpenBLAS; the C library and compiled code without newer instructions; NumPy without AVX-512,
# then without any optional instructions.
PROCESSORS ?= OPENBLAS_CORETYPE=Haswell OPENBLAS_CORETYPE=Zen $(if $(shell grep -m1 avx512f /proc/cpuinfo 2> /dev/null),OPENBLAS_CORETYPE=SkylakeX) \
	GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA NUMBA_CPU_NAME=generic NPY_DISABLE=AVX512 NPY_DISABLE=all
# Tests that compare numbers with those that ship.
IDENTITY = tests/test_identity.py tests/turning_env/scenario/test_family.py tests/leaderboard/test_shipped.py
FEATURES = import sys; from numpy._core._multiarray_umath import __cpu_dispatch__ as names; \
	print(*(name for name in names if sys.argv[1] == "all" or "AVX512" in name or name == "X86_V4"))
TESTS ?= -m "not slow"

# Else each process compiles the sources of its libraries again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup leaderboard agents seeds results verify check lint types fast test mutants system control processors soak wheel clients constraints format site clean

# The targets, each with the first sentence of its comment.
help:
	@awk '/^# / {comment = comment == "" ? substr($$0, 3) : comment " " substr($$0, 3); next} \
		/^[a-z]+:/ && comment != "" {sub(/:.*/, "", $$1); sub(/\. .*/, ".", comment); printf "%-12s %s\n", $$1, comment} \
		{comment = ""}' $(firstword $(MAKEFILE_LIST))

# Install all that training, tuning, scoring and the papers need.
setup: .venv/run

# Train an agent, play it, and rank it with every policy that ships: their results need not be played again. Set-up included, it takes 50 s on two
# cores of an AMD EPYC with wheels at hand.
leaderboard: .venv/run
	@echo "training an agent for a million steps and ranking it: about a minute"
	run=$$($(TRAIN) --seed 0) && .venv/bin/python -m train.export $$run --out $(RUNS)/first/agents && $(RUN) --replace --agents $(RUNS)/first/agents/*.onnx

# Train the agents that ship anew by the commands on their cards, two at a time, and export them and their learning curves (a very short training
# has none).
agents: .venv/run
	for card in $(CARDS); do sed -n "s|^python \(-m train.*--seed [$(SEEDS)].*\)|$${card%.md} \1|p" $$card; done | tr '\n' '\0' | xargs -0 -P 2 -n 1 sh -c '\
		set -e; agent=$${0%% *}; name=$${agent##*/}; \
		run=$$(eval ".venv/bin/python $${0#* } --runs $(RUNS)/$$name $(if $(STEPS),--steps $(STEPS))"); \
		out=$(SHIPPED)/$${agent#agents/}; .venv/bin/python -m train.export $$run --name $$name --out $${out%/*}'
	set -e; for card in $(CARDS); do \
		name=$$(basename $$card .md); out=$(SHIPPED)/$${card#agents/}; curves=$${out%/*}/learning_curves.json; \
		runs=$$(ls -d $(RUNS)/$$name/*/*/*-seed[0-9] 2> /dev/null) || continue; \
		.venv/bin/python -m train.curves $$(ls $$curves 2> /dev/null) $$runs --name $$name --out $$curves || true; \
	done

# Restore the agents of the other training seeds, which agents/SHA256SUMS lists, from the commit that holds all.
seeds:
	git cat-file -e $(ALL_SEEDS) || git fetch --depth 1 origin $(ALL_SEEDS)
	git restore --source=$(ALL_SEEDS) -- ':(glob)agents/**/*-seed[1-9].onnx'

# Play every policy that ships, and write the agents' cards.
results: .venv/run
	set -e; for env in $(ENVS); do \
		case $$env in \
			RoughTurning-v0) seeds="--seeds $(NUM_SEEDS) --splits --split-seeds $(SPLIT_SEEDS)";; \
			RoughTurning-Batch-v0) seeds="--seeds $(NUM_SEEDS)";; \
			RoughTurning-Shift-v0) seeds="--seeds $(SPLIT_SEEDS)";; \
			RoughTurning-Family-v1) \
				play=".venv/bin/python -m leaderboard run --env $$env --results $(SHIPPED_RESULTS) --jobs $(JOBS) --seeds $(NUM_SEEDS)"; \
				$$play --splits --policies $(DEGENERATE) random fixed_nominal_optimum fixed_nominal_share load_loop_jobs predictive self_tuning causal; \
				$$play --splits --policies predictive self_tuning --knows true_laws; \
				$$play --policies self_tuning --forgets; \
				$$play --scenario unmodelled --splits --policies idle never_cut random fixed_nominal_optimum fixed_nominal_share load_loop_jobs predictive self_tuning chip_window reactive known_forms causal; \
				continue;; \
			*) seeds="--seeds $(TASK_SEEDS)";; \
		esac; \
		.venv/bin/python -m leaderboard run --env $$env --results $(SHIPPED_RESULTS) --jobs $(JOBS) $$seeds \
			--keep-names --replace --agents $$(ls $(SHIPPED)/$$env/*/*.onnx 2> /dev/null); \
	done
	.venv/bin/python -m leaderboard cards --results $(SHIPPED_RESULTS) --agents $(SHIPPED)
	.venv/bin/python -m leaderboard pack --results $(SHIPPED_RESULTS) --validation

# Play the results that ship again and fail if a number differs.
verify: .venv/run
	.venv/bin/python -m leaderboard verify --jobs $(JOBS) $(VERIFY)

# Lint, types and fast tests, side by side: a minute.
check: .venv/test
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=target fast lint types

# Lint, and the form of the code.
lint: .venv/test
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .

# Static types.
types: .venv/test
	.venv/bin/mypy

# The fast tests.
fast: .venv/test .venv/compiled
	$(PYTEST) -m "not slow"

# Lint, types and all tests.
test: .venv/test
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=target lint types .venv/compiled
	$(PYTEST)

# Small wrong edits of the core that its tests of the same name let pass; FILES= and SAMPLE= choose some.
mutants: .venv/test
	.venv/bin/python -m tools.mutants $(FILES) $(if $(SAMPLE),--sample $(SAMPLE))

# Install what tests need beside Python: Chromium and LinuxCNC, from Debian. Without them `make test` leaves tests out, and says so at its end.
system:
	.ci/system

# The faults of a control on LinuxCNC, of which one runs on a machine at a time: five minutes.
control: .venv/test
	.ci/control

# Fast tests and those of what ships as other processors compute, one after the other; TESTS= runs the slow ones, too.
# PROCESSORS=OPENBLAS_CORETYPE=Haswell imitates one.
processors: .venv/test
	set -e; failed=; for setting in $(PROCESSORS); do \
		case $$setting in \
			NPY_DISABLE=*) what="NPY_DISABLE_CPU_FEATURES=$$(.venv/bin/python -c '$(FEATURES)' $${setting#*=})";; \
			*) what=$$setting;; \
		esac; \
		echo "== $$what"; env "$$what" $(PYTEST) --timeout 0 $(TESTS) \
			&& env "$$what" HYPOTHESIS_PROFILE=soak $(PYTEST) --timeout 0 $(IDENTITY) || failed="$$failed $$setting"; \
	done; test -z "$$failed" || { echo "failed with:$$failed"; exit 1; }

# The promises of docs/soundness.md on far more inputs, kills and steps than in the tests: some hours.
soak: .venv/test
	HYPOTHESIS_PROFILE=soak .venv/bin/pytest tests/soundness shop/tests/soundness -n 2 --timeout 0 --hypothesis-show-statistics
	HYPOTHESIS_PROFILE=soak .venv/bin/pytest -m soak -n 2 --timeout 0
	.venv/bin/python -m tools.soak

# The wheel in an empty environment: its contents, and that every task gives the same bytes there; likewise with other versions of Python.
wheel: .venv/run
	.venv/bin/python -m tools.wheel --python .venv/bin/python $(OTHER_PYTHON)

# The recipes of other libraries (docs/ecosystem.md), each in an environment of its own; CLIENTS="skrl" tries one. Minutes each.
clients: .venv/run
	.venv/bin/python -m tools.clients --write docs/ecosystem.md $(CLIENTS)

# Resolve pyproject.toml into packaging/constraints.txt, for all platforms. Versions stay, unless UPGRADE=--upgrade is given. Hashes of other builds stay
# with their version, such as that of torch without CUDA, which the index does not serve: `pip hash` gives that of a new one.
constraints: .venv/run
	$(INSTALL) --group pin
	.venv/bin/uv pip compile --quiet --universal --python-version 3.11.5 --generate-hashes --no-annotate \
		--custom-compile-command "make constraints" $(UPGRADE) --no-emit-package rough-turning -o packaging/constraints.txt pyproject.toml shop/pyproject.toml \
		$(addprefix --extra ,$(RUN_EXTRAS) $(TEST_EXTRAS)) --group setup --group pin

# Mend lint and form.
format: .venv/test
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

# The site, in site/; SERVE=1 shows it while you write.
site: .venv/test
	.venv/bin/python -m mkdocs $(if $(SERVE),serve,build --strict) -f packaging/mkdocs.yml

# Remove the virtual environment, training runs and results of this clone.
clean:
	rm -rf .venv $(RUNS) $(RESULTS)

# pip installs uv, which installs the rest in seconds.
.venv/run: pyproject.toml shop/pyproject.toml packaging/constraints.txt
	@echo "setting up .venv: under a minute with wheels at hand; downloads take longer"
	test -x .venv/bin/python || $(PYTHON) -m venv .venv
	sed -n '/^uv==/,/[^\]$$/p' packaging/constraints.txt | $(PIP) install --quiet --no-compile -r /dev/stdin
	$(INSTALL) --group setup
	$(call install,$(RUN_EXTRAS))
	$(UV) --no-deps --no-build-isolation -e . -e shop
	touch $@

# Machine code, bytecode and mypy's cache are part of the set-up, so that the first `make check` is as quick as the next: pytest imports all that it
# collects.
.venv/test: .venv/run
	@echo "adding what tests need, and compiling: with all before, 64 s on two cores of an AMD EPYC, once"
	$(call install,$(TEST_EXTRAS))
	(.venv/bin/mypy > .venv/types.txt || true) & { .venv/bin/pytest --collect-only > .venv/tests.txt 2>&1 || true; } \
		&& .venv/bin/python -m shop.tests.compile && touch .venv/compiled && wait
	touch $@

# Machine code of what the tests play, which a change of any source may change.
.venv/compiled: $(shell find turning_env baselines train leaderboard research shop tests -name '*.py') | .venv/test
	.venv/bin/python -m shop.tests.compile
	touch $@
