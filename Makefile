# draped: garments at rest, over HTTP. `make help` lists what there is to make.

SHELL   := /bin/bash
FLAVOUR ?= release

# ---- what is built from what ---------------------------------------------------------------

# Objects of each flavour live apart, so flavours never mix; the release binaries land in build/.
OBJ     := build/$(FLAVOUR)/obj
BIN     := $(if $(filter release,$(FLAVOUR)),build,build/$(FLAVOUR))
TBIN    := build/$(FLAVOUR)/tests

SOLVER_SRC := $(wildcard solver/*.c)
SERVER_SRC := $(filter-out server/main.c,$(wildcard server/*.c))
CLIENT_SRC := $(filter-out client/main.c,$(wildcard client/*.c))
SOLVER_OBJ := $(SOLVER_SRC:%.c=$(OBJ)/%.o)
SERVER_OBJ := $(SERVER_SRC:%.c=$(OBJ)/%.o)
CLIENT_OBJ := $(CLIENT_SRC:%.c=$(OBJ)/%.o)

UNIT_SRC    := $(wildcard tests/solver/test_*.c tests/server/test_*.c tests/client/test_*.c)
PHYSICS_SRC := $(wildcard tests/physics/test_*.c)
TEST_SRC    := $(UNIT_SRC) $(PHYSICS_SRC)
UNIT_TESTS  := $(UNIT_SRC:tests/%.c=$(TBIN)/%)
TESTS       := $(TEST_SRC:tests/%.c=$(TBIN)/%)
FUZZ_SRC    := $(wildcard tests/fuzz/fuzz_*.c)
FUZZERS     := $(FUZZ_SRC:tests/%.c=$(TBIN)/%)

ALL_SRC := $(wildcard solver/*.c server/*.c client/*.c) $(TEST_SRC) $(FUZZ_SRC) \
           $(wildcard tests/api/*.c tests/preload/*.c tests/stability/*.c tests/counts/*.c tests/bench/*.c)
ALL_HDR := $(wildcard solver/*.h server/*.h client/*.h tests/*.h tests/*/*.h)

# ---- compiler ------------------------------------------------------------------------------

ifeq ($(origin CC),default)
CC := gcc
endif

# Bugs that hide in silence: shadowed names, missing prototypes, lost qualifiers, implicit narrowing
# of pointers, printf formats, fall-through.
WARN := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wold-style-definition \
        -Wcast-qual -Wwrite-strings -Wpointer-arith -Wformat=2 -Wvla -Wundef -Wimplicit-fallthrough
# `make check` passes WERROR=1.
WERROR ?=
# FMA contraction is off so that the same source gives the same bytes from every compiler.
CSTD := -std=c17 -D_GNU_SOURCE -ffp-contract=off -fno-math-errno

SAN_release :=
SAN_asan    := -fsanitize=address -fno-omit-frame-pointer
SAN_ubsan   := -fsanitize=undefined -fno-sanitize-recover=all
SAN_tsan    := -fsanitize=thread
SAN_cover   := --coverage
SAN_fuzz    := -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=all
OPT_release := -O2 -g
OPT_asan    := -O1 -g
OPT_ubsan   := -O1 -g
OPT_tsan    := -O1 -g
OPT_cover   := -O0 -g
OPT_fuzz    := -O1 -g
SAN := $(SAN_$(FLAVOUR))
OPT := $(OPT_$(FLAVOUR))
ifeq ($(OPT),)
$(error FLAVOUR=$(FLAVOUR): take release, asan, ubsan, tsan, cover or fuzz)
endif

# Everything that asks pkg-config is expanded in a recipe only, after `make packages` has run.
PKG = $(shell pkg-config --cflags $(1) 2>/dev/null)
LIB = $(shell pkg-config --libs $(1) 2>/dev/null)
CFLAGS  ?=
LDFLAGS ?=
ALLFLAGS = $(CSTD) $(OPT) $(SAN) $(WARN) $(if $(WERROR),-Werror) -MMD -MP -pthread $(CFLAGS)

# OpenBLAS comes first: its own thread-count call must speak to the BLAS that CHOLMOD uses.
# libgomp: the solver turns off the OpenMP nesting that CHOLMOD would use.
SOLVER_LIBS = -lopenblas -lcholmod -lgomp -lm
SERVER_LIBS = $(SOLVER_LIBS) $(call LIB,libmicrohttpd jansson sqlite3 libsodium libsystemd inih plplot zlib libzstd) -lm
CLIENT_LIBS = $(call LIB,libcurl jansson osmesa libpng plplot) -lGLU -lm

# Include paths by folder: who may see whose headers. The client sees nobody else's.
# -iquote: our limits.h must not stand before the C library's <limits.h>.
SUITESPARSE       := -isystem /usr/include/suitesparse
INC_solver         = -iquote solver $(SUITESPARSE)
INC_server         = -iquote server -iquote solver $(call PKG,libmicrohttpd jansson sqlite3 libsodium libsystemd inih plplot zlib libzstd)
INC_client         = -iquote client $(call PKG,libcurl jansson osmesa libpng plplot)
INC_tests/solver   = -iquote tests $(INC_solver)
INC_tests/physics  = -iquote tests -iquote solver
INC_tests/server   = -iquote tests $(INC_server)
INC_tests/client   = -iquote tests $(INC_client)
INC_tests/stability = $(INC_tests/physics)
INC_tests/counts    = -iquote solver
INC_tests/fuzz     = -iquote tests $(INC_server)
INC_tests/api      =
INC_tests/preload  =
INC_tests/bench    =
folder = $(patsubst %/,%,$(dir $(1)))

# ---- the binaries --------------------------------------------------------------------------

.PHONY: all
all: $(BIN)/draped $(BIN)/drape ## build build/draped and build/drape (the default)

# One word and a file for each step; V=1 shows whole commands.
Q = $(if $(V),,@echo '  $(1)  $@' &&)

$(OBJ)/%.o: %.c
	@mkdir -p $(@D)
	$(call Q,CC)$(CC) $(ALLFLAGS) $(INC_$(call folder,$<)) -c $< -o $@

# The kernels of a preconditioner: whichever processor it is, conjugate gradients around it are as exact.
# Their test includes them.
$(OBJ)/solver/front.o $(OBJ)/tests/solver/test_front.o: CSTD += -ffp-contract=fast

# The daemon's threads count together, and tests/preload/flush.c asks for the counts.
build/cover/obj/server/%.o: SAN += -fprofile-update=atomic
build/cover/draped: LDFLAGS += $(foreach f,__gcov_dump __gcov_reset,-Wl,-u,$(f),--export-dynamic-symbol=$(f))

# assets.c embeds it, which -MMD does not see.
$(OBJ)/server/assets.o: server/openapi.json

$(OBJ)/libdrape.a: $(SOLVER_OBJ)
$(OBJ)/server.a: $(SERVER_OBJ)
$(OBJ)/client.a: $(CLIENT_OBJ)
$(OBJ)/%.a:
	@mkdir -p $(@D)
	@rm -f $@
	$(call Q,AR)ar rcs $@ $^

LINK = @mkdir -p $(@D) && $(if $(V),set -x;,echo '  LD  $@' &&) $(CC) $(OPT) $(SAN) -pthread $(LDFLAGS) -o $@ $^

# What the server is linked to. Where lines are counted that is the release's: the solver's own tests measure the
# solver, and unoptimised it takes minutes for what the API tests drape.
LIBDRAPE := $(OBJ)/libdrape.a
ifeq ($(FLAVOUR),cover)
LIBDRAPE := build/release/obj/libdrape.a
.PHONY: always
$(LIBDRAPE): always
	@$(MAKE) --no-print-directory FLAVOUR=release $@
endif

$(BIN)/draped: $(OBJ)/server/main.o $(OBJ)/server.a $(LIBDRAPE)
	$(LINK) $(SERVER_LIBS)

$(BIN)/drape: $(OBJ)/client/main.o $(OBJ)/client.a
	$(LINK) $(CLIENT_LIBS)

# ---- the test programs ---------------------------------------------------------------------

$(TBIN)/solver/%: $(OBJ)/tests/solver/%.o $(OBJ)/libdrape.a
	$(LINK) $(SOLVER_LIBS) -lcmocka

$(TBIN)/physics/%: $(OBJ)/tests/physics/%.o $(OBJ)/libdrape.a
	$(LINK) $(SOLVER_LIBS) -lcmocka

# The stability suite: a short form among the physics tests and a long form of its own.
STABILITY_OBJ := $(OBJ)/tests/stability/rows.o $(OBJ)/tests/stability/cases.o $(OBJ)/libdrape.a
$(TBIN)/physics/test_stability: $(OBJ)/tests/physics/test_stability.o $(STABILITY_OBJ)
	$(LINK) $(SOLVER_LIBS) -lcmocka
$(TBIN)/stability: $(OBJ)/tests/stability/stability.o $(STABILITY_OBJ)
	$(LINK) $(SOLVER_LIBS) -lcmocka

$(TBIN)/server/%: $(OBJ)/tests/server/%.o $(OBJ)/server.a $(LIBDRAPE)
	$(LINK) $(SERVER_LIBS) -lcmocka

$(TBIN)/client/%: $(OBJ)/tests/client/%.o $(OBJ)/client.a
	$(LINK) $(CLIENT_LIBS) -lcmocka

$(TBIN)/fuzz/%: $(OBJ)/tests/fuzz/%.o $(OBJ)/server.a $(OBJ)/libdrape.a
	$(LINK) -fsanitize=fuzzer $(SERVER_LIBS)

# One program for tests/counts/counts.sh, linked to the whole library and, for each scene, to the objects that
# the scene needs and stubs in the place of all others. The same shared libraries in all: they shape the heap.
LEAN_core  := error clock scene mesh stretch cloth plan sim relax
LEAN_steps := $(LEAN_core) bend matrix order implicit
LEAN_auto  := $(LEAN_core) bend matrix order front mixed
LEAN_rk4   := $(LEAN_core) bend explicit
LEAN_limp  := $(LEAN_core) matrix order implicit
COUNTS     := whole steps auto rk4 limp
LEAN_whole := $(SOLVER_SRC:solver/%.c=%)
$(OBJ)/tests/counts/stubs-%.o: tests/counts/stubs.sh $(SOLVER_OBJ)
	@mkdir -p $(@D)
	$(call Q,CC)tests/counts/stubs.sh $(filter-out $(LEAN_$*:%=$(OBJ)/solver/%.o),$(SOLVER_OBJ)) | $(CC) $(OPT) -fno-builtin -x c -c -o $@ -
define counts_program
$(TBIN)/counts/$(1): $(OBJ)/tests/counts/driver.o $(OBJ)/tests/counts/stubs-$(1).o $(LEAN_$(1):%=$(OBJ)/solver/%.o)
	$$(LINK) -Wl,--no-as-needed $$(SOLVER_LIBS)
endef
$(foreach c,$(COUNTS),$(eval $(call counts_program,$(c))))

# What the API tests measure a drape with: these share no code with the solver.
API_TOOLS := $(patsubst tests/%.c,$(TBIN)/%,$(wildcard tests/api/*.c))
$(TBIN)/api/%: $(OBJ)/tests/api/%.o
	$(LINK) -lm
# The floor of `make bench`: the rates of the BLAS that the solver uses.
$(TBIN)/bench/%: $(OBJ)/tests/bench/%.o
	$(LINK) -lopenblas

# What the API tests put between the daemon and the system, by LD_PRELOAD.
PRELOADS := $(patsubst tests/%.c,$(TBIN)/%.so,$(wildcard tests/preload/*.c))
$(TBIN)/preload/%.so: tests/preload/%.c
	@mkdir -p $(@D)
	$(call Q,CC)$(CC) $(filter-out -MMD -MP,$(ALLFLAGS)) -fPIC -shared -o $@ $<

.SECONDARY:

.PHONY: tests unit-tests api-tools fuzzers
api-tools: $(API_TOOLS) $(PRELOADS) ## build what the tests of the API need beside the two programs
tests: $(TESTS) api-tools $(COUNTS:%=$(TBIN)/counts/%) ## build the unit and physics tests without running them
unit-tests: $(UNIT_TESTS)
fuzzers: $(FUZZERS)

# ---- first run, and the whole test ---------------------------------------------------------

# One job per processor unless the caller has said how many.
JOBS = $(if $(findstring -j,$(MAKEFLAGS)),,-j$(shell nproc))

.PHONY: packages
packages: ## install the Debian packages that a build lacks (says which and why)
	@tests/packages.sh build

.PHONY: demo
demo: ## drape a garment on a mannequin: GLB, picture and trace land in build/demo
	@tests/packages.sh build
	@$(MAKE) --no-print-directory $(JOBS) all
	@tests/demo.sh

.PHONY: check
check: ## run every test; the last line is the count (CHECK="unit api" picks parts)
	@tests/packages.sh check || { echo '0 passed, 1 failed'; exit 1; }
	+@MAKE='$(MAKE) --no-print-directory $(JOBS) WERROR=1' tests/run.sh $(CHECK)

.PHONY: check-stability
check-stability: ## run every stability case under every method (minutes); the table lands in build/stability.txt
	@tests/packages.sh build
	+@$(MAKE) --no-print-directory $(JOBS) $(TBIN)/stability
	@$(TBIN)/stability -j $$(nproc) -o build/stability.txt

.PHONY: asan ubsan tsan
asan ubsan tsan: ## build that flavour and run its unit tests and the API smoke test
	+@MAKE='$(MAKE) --no-print-directory $(JOBS)' tests/run.sh $@

.PHONY: bench
bench: ## time and iterations of every scene and size by method, against the floor: build/bench.md, bench.html (hours)
	@tests/packages.sh build
	@$(MAKE) --no-print-directory $(JOBS) all $(TBIN)/bench/floor
	@tests/bench/bench.sh

.PHONY: bench-methods
bench-methods: ## compare methods on 22 scenes, the paper's square and wrinkles (an hour): build/bench-*.md, README.md
	@tests/packages.sh build
	@$(MAKE) --no-print-directory $(JOBS) all
	@tests/bench/methods.sh
	@case wrinkles in $(if $(SCENES),$(SCENES),*)) tests/bench/wrinkles.sh;; esac

.PHONY: bench-wrinkles
bench-wrinkles: ## compare every method on the paper's wrinkle test, 19 250 triangles (half an hour)
	@tests/packages.sh build
	@$(MAKE) --no-print-directory $(JOBS) all
	@tests/bench/wrinkles.sh

.PHONY: bench-garments
bench-garments: ## drape real garments on a real body (hours): build/bench-garments.md, pictures
	@tests/packages.sh build
	@$(MAKE) --no-print-directory $(JOBS) all $(API_TOOLS)
	@tests/bench/garments.sh

COVER ?= solver server client
.PHONY: cover
cover: ## line and branch coverage by gcov (COVER="server" picks folders)
	@tests/packages.sh check
	+@MAKE='$(MAKE) --no-print-directory $(JOBS)' tests/cover.sh $(COVER)

FUZZ_RUNS    ?= 100000
FUZZ_SECONDS ?= 600
.PHONY: fuzz fuzz-long
fuzz: ## run each fuzzer FUZZ_RUNS times (clang, ASan, UBSan)
	+@FUZZ_RUNS=$(FUZZ_RUNS) MAKE='$(MAKE) --no-print-directory $(JOBS)' tests/run.sh fuzz
fuzz-long: ## run each fuzzer for FUZZ_SECONDS, growing its corpus in build/fuzz/corpus
	@$(MAKE) --no-print-directory $(JOBS) FLAVOUR=fuzz CC=clang fuzzers
	@for f in $(FUZZ_SRC:tests/fuzz/%.c=%); do mkdir -p build/fuzz/corpus/$$f; \
	 build/fuzz/tests/fuzz/$$f -max_total_time=$(FUZZ_SECONDS) -timeout=10 -rss_limit_mb=2048 \
	   -artifact_prefix=build/fuzz/ build/fuzz/corpus/$$f $$(ls -d tests/fuzz/corpus/$$f 2>/dev/null) || exit 1; done

.PHONY: break break-long
break: ## run all that tries to break the daemon, as make check does; its counts land in build/break-short.md
	@tests/packages.sh check
	+@$(MAKE) --no-print-directory $(JOBS) all tests
	+@$(MAKE) --no-print-directory $(JOBS) FLAVOUR=fuzz CC=clang fuzzers
	@tests/break.sh short $(BREAK)
break-long: ## the same in the sizes for a night (BREAK="kill slow" picks): build/break-long.md
	@tests/packages.sh check
	+@$(MAKE) --no-print-directory $(JOBS) all tests
	+@$(MAKE) --no-print-directory $(JOBS) FLAVOUR=fuzz CC=clang fuzzers
	@tests/break.sh long $(BREAK)

.PHONY: bench-load
bench-load: ## count status requests a second while every worker solves: build/bench-load.md
	@tests/packages.sh build && tests/packages.sh bench
	@$(MAKE) --no-print-directory $(JOBS) all
	@tests/bench/load.sh

# ---- upkeep --------------------------------------------------------------------------------

.PHONY: format
format: ## clang-format every C file in place
	@tests/packages.sh upkeep
	clang-format -i $(ALL_SRC) $(ALL_HDR)

.PHONY: lint
lint: compile_commands.json ## clang-tidy and cppcheck
	clang-tidy --quiet -p . $(wildcard solver/*.c server/*.c client/*.c)
	cppcheck --quiet --std=c11 --enable=warning,performance,portability --inline-suppr --error-exitcode=1 \
	  --suppress=missingIncludeSystem --suppress=comparePointers:server/api_about.c --suppress=arrayIndexThenCheck \
	  -D_GNU_SOURCE -Isolver -Iserver -Iclient solver server client

# One entry per source, for clangd and clang-tidy; jq does the quoting.
compile_commands.json: Makefile $(ALL_SRC) ## write the compilation database
	@tests/packages.sh upkeep
	@{ $(foreach s,$(ALL_SRC),printf '%s\t%s\n' '$(s)' '$(CC) $(CSTD) $(WARN) $(INC_$(call folder,$(s))) -c $(s)';) } \
	 | jq -Rn --arg dir '$(CURDIR)' '[inputs / "\t" | {directory: $$dir, file: .[0], command: .[1]}]' > $@

PREFIX  ?= /usr/local
DESTDIR ?=
UNITDIR ?= $(PREFIX)/lib/systemd/system
DOCDIR  := $(PREFIX)/share/doc/draped
# A manual page of what a program says of itself: MAN program,section
MAN = build/$(1) --help | systemd/man.awk -v name=$(1) -v section=$(2) | gzip -9n > $(DESTDIR)$(PREFIX)/share/man/man$(2)/$(1).$(2).gz
.PHONY: install
install: all ## install programs, units, manual pages and README (PREFIX, DESTDIR, UNITDIR)
	install -D -m 755 build/draped $(DESTDIR)$(PREFIX)/bin/draped
	install -D -m 755 build/drape $(DESTDIR)$(PREFIX)/bin/drape
	install -D -m 644 README.md $(DESTDIR)$(DOCDIR)/README.md
	install -D -m 644 LICENSE $(DESTDIR)$(DOCDIR)/LICENSE
	install -D -m 644 systemd/draped.conf $(DESTDIR)$(DOCDIR)/examples/draped.conf
	install -d $(DESTDIR)$(UNITDIR) $(DESTDIR)$(PREFIX)/share/man/man1 $(DESTDIR)$(PREFIX)/share/man/man8
	install -m 644 systemd/draped.socket systemd/draped-admin.socket $(DESTDIR)$(UNITDIR)
	sed -e 's|@bindir@|$(PREFIX)/bin|; s|@docdir@|$(DOCDIR)|' systemd/draped.service > $(DESTDIR)$(UNITDIR)/draped.service
	$(call MAN,draped,8)
	$(call MAN,drape,1)

.PHONY: deb
deb: all ## make a Debian package of what is installed: build/draped_VERSION_ARCH.deb
	@tests/packages.sh deb
	@MAKE='$(MAKE) --no-print-directory' systemd/deb.sh

.PHONY: clean
clean: ## remove everything that make made
	rm -rf build compile_commands.json

.PHONY: help
help: ## list the targets
	@awk -F':.*## ' '/^[a-z][a-z_. -]*:.*## /{printf "  %-22s %s\n", $$1, $$2}' $(firstword $(MAKEFILE_LIST))

-include $(shell find build/$(FLAVOUR) -name '*.d' 2>/dev/null)
