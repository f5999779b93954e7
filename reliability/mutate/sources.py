"""Owns which sources are mutated, and the build that holds all their mutants."""

import subprocess
import sys

from reliability import builds

from .mutants import Source

NAME = "mutants"
FILES = (
    *(f"tf2_py/_core/{name}" for name in (
        "cache.pxd", "cache_copy.pyx", "cache_find.pxd", "cache_find.pyx", "cache_insert.pyx",
        "cache_memory.pyx", "change.pxd", "change.pyx", "geometry.pxd", "lacks.pyx", "lookup.pyx",
        "path.pxd", "path.pyx",
        "reference_walk.pyx", "tree.pxd", "tree.pyx", "waiters.pyx", "walk.pyx", "watches.pyx",
    )),
    "tf2_py/_engine/engine.pyx",
    "tf2_py/_engine/wait.pyx",
)  # fmt: skip
# What only the self check of the tests runs. That of caches and trees also judges files and pickles.
SELF_CHECK = {"waiters_check", "_check_list", "watches_check"}

# Variables begin as 0: where a mutant removes an assignment, the compiler may not take it for made.
_CFLAGS = ("-ftrivial-auto-var-init=zero", "-w")
_COMPILER = """#!/bin/sh
# -O3 of so many branches takes long to compile.
for word do
    shift
    [ "$word" = -O3 ] && word=-O1
    set -- "$@" "$word"
done
exec {compiler} "$@"
"""


def read():
    """The sources, as they are in the checkout."""
    sources, first = [], 1
    for name in FILES:
        sources.append(Source(name, (builds.ROOT / name).read_text(), first, SELF_CHECK))
        first += len(sources[-1].mutants)
    return sources


def build(sources, compiler):
    """Build all mutants of the sources; return the folder of the build."""
    library = builds.BUILDS / f"{NAME}-switch"
    library.mkdir(parents=True, exist_ok=True)
    wrapper = library / "cc"
    wrapper.write_text(_COMPILER.format(compiler=compiler))
    wrapper.chmod(0o755)
    code = builds.ROOT / "reliability" / "mutate" / "switch.c"
    output = library / "libtf2_mutants.so"
    flags = ["-shared", "-fPIC", "-O1", f"-DMUTANTS={size(sources)}", "-o", str(output)]
    subprocess.run([*compiler.split(), *flags, str(code)], check=True)
    return builds.build(
        NAME,
        cflags=_CFLAGS,
        ldflags=(f"-L{library}", "-Wl,--no-as-needed", "-ltf2_mutants", f"-Wl,-rpath,{library}"),
        python=sys.executable,
        rewritten={source.name: source.mutated() for source in sources},
        CC=str(wrapper),
    )


def size(sources):
    """One more than the greatest number of a mutant."""
    return 1 + sum(len(source.mutants) for source in sources)
