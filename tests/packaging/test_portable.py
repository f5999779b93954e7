"""
The C of all but the receiver and shared memory: of C11 and POSIX.1-2008, and of no one's kernel or C library.

The receiver is where ROS is, and buffers are shared on Linux; buffers and recordings are everywhere.
"""

import os
import re
import shlex
import shutil
import subprocess
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import Cython
import numpy
import pytest
from paths import ROOT
from sources import extensions

pytestmark = pytest.mark.ours

# C's atexit does not pass on the exit status; where the C library has nothing else, it does without.
OF_GLIBC = {"tf2_ros._rcl"}
EXTENSIONS = sorted(extensions())
OF_LINUX = {"tf2_ros._shared.ring"}
PORTABLE = [name for name in EXTENSIONS if name not in OF_GLIBC | OF_LINUX]

STANDARD = {
    # C11
    *(
        "float.h",
        "limits.h",
        "math.h",
        "stdbool.h",
        "stddef.h",
        "stdint.h",
        "stdio.h",
        "stdlib.h",
        "string.h",
    ),
    # POSIX.1-2008
    *("pthread.h", "signal.h", "sys/time.h", "sys/types.h", "time.h", "unistd.h"),
    # The processor's, in what is compiled only for that processor.
    "immintrin.h",
    # Of Windows.
    "malloc.h",
    # Those that Cython chooses from, by compiler and system.
    *("Windows.h", "atomic", "cmath", "complex", "complex.h", "cstdlib", "intrin.h", "mutex", "omp.h"),
    *("stdalign.h", "stdatomic.h", "threads.h", "type_traits"),
}
OF_PYTHON = re.compile(
    r"Python\.h|(pythread|compile|traceback|structmember|\w+object|internal/\w+)\.h|numpy/.*"
)

# What C11 and POSIX.1-2008 name, as far as it is used; what is added here must be one of theirs.
OF_C = """
acos asin atan atan2 calloc cos fabs fmod free malloc memchr memcmp memcpy memmove memset realloc sin sqrt
strchr strcmp strlen strncmp strrchr vsnprintf snprintf isfinite abort fputs stderr aligned_alloc
""".split()
OF_POSIX = """
clock_gettime nanosleep pthread_atfork pthread_cond_broadcast pthread_cond_destroy pthread_cond_init
pthread_cond_signal pthread_cond_timedwait pthread_condattr_destroy pthread_condattr_init
pthread_condattr_setclock pthread_equal pthread_mutex_destroy pthread_mutex_init pthread_mutex_lock
pthread_mutex_unlock pthread_self
""".split()
# What compilers and the C library make of a program by themselves.
OF_COMPILERS = re.compile(
    r"_ITM_\w+|__gmon_start__|__cxa_\w+|__stack_chk_fail|__register_atfork|__cpu_model|__gcov_\w+|__(?:[at]|ub)san_\w+"
)


def generated(name):
    """The C that Cython made of a module, for the build in place."""
    path = ROOT / "build" / f"cython-{Cython.__version__}" / f"{name.replace('.', '/')}.c"
    if not path.is_file():
        pytest.skip("the extensions were not built in place by this Cython")
    return path


def compiler():
    command = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    if shutil.which(command[0]) is None:
        pytest.skip(f"there is no {command[0]}")
    return command


@pytest.fixture(scope="module")
def compile_strictly(tmp_path_factory):
    """
    Compiles a file, to no end, and returns what the compiler says against it.

    Before all else, headers are included that offer the names of POSIX alone. They heed such a wish once:
    what Python's headers then ask for comes too late.
    """
    first = tmp_path_factory.mktemp("portable") / "posix_alone.h"
    wish = "_POSIX_C_SOURCE 200809L"
    first.write_text(f"#define {wish}\n#include <stdlib.h>\n#undef {wish.split()[0]}\n")
    command = [*compiler(), "-fsyntax-only", "-std=c11", "-Werror=implicit-function-declaration"]
    command += ["-include", str(first), f"-I{sysconfig.get_path('include')}", f"-I{numpy.get_include()}"]

    def compile_it(path):
        ended = subprocess.run([*command, str(path)], text=True, capture_output=True)
        return ended.stderr if ended.returncode else ""

    return compile_it


def included(text):
    return re.findall(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', text, re.MULTILINE)


def foreign(text):
    return [header for header in included(text) if header not in STANDARD and not OF_PYTHON.fullmatch(header)]


@pytest.mark.parametrize("name", PORTABLE)
def test_it_includes_headers_of_c_and_posix_and_python(name):
    assert foreign(generated(name).read_text(encoding="utf-8")) == []


def test_it_compiles_where_headers_offer_posix_alone(compile_strictly):
    with ThreadPoolExecutor(os.cpu_count()) as several:
        said = dict(zip(PORTABLE, several.map(compile_strictly, map(generated, PORTABLE)), strict=True))
    assert {name: text for name, text in said.items() if text} == {}


@pytest.mark.parametrize(
    ("header", "call"),
    [
        ("semaphore.h", "sem_clockwait((sem_t *)0, 0, (struct timespec *)0)"),
        ("stdlib.h", "on_exit(0, 0)"),
        ("pthread.h", "pthread_setname_np(pthread_self(), 0)"),
        ("sys/eventfd.h", "eventfd(0, 0)"),
    ],
)
def test_the_checks_find_what_is_not_of_posix(compile_strictly, tmp_path, header, call):
    text = f"#define _GNU_SOURCE 1\n#include <time.h>\n#include <{header}>\nint main(void) {{ {call}; }}\n"
    (tmp_path / "foreign.c").write_text(text)
    assert foreign(text) or "implicit declaration" in compile_strictly(tmp_path / "foreign.c")


@pytest.mark.skipif(shutil.which("nm") is None, reason="nm is not installed")
@pytest.mark.parametrize("name", PORTABLE)
def test_it_calls_functions_of_c_and_posix_and_python(name):
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    built = Path(ROOT, f"{name.replace('.', '/')}{suffix}")
    if not built.is_file():
        pytest.skip("the extensions were not built in place")
    listed = subprocess.run(
        ["nm", "-D", "--undefined-only", built], text=True, capture_output=True, check=True
    )
    called = {line.split()[-1].partition("@")[0] for line in listed.stdout.splitlines()}
    # Of a build that checks sizes, __memcpy_chk is memcpy.
    called = {re.sub(r"^__(\w+)_chk$", r"\1", one) for one in called}
    others = {one for one in called if not re.match(r"_?Py", one) and not OF_COMPILERS.fullmatch(one)}
    assert "" not in called and called
    assert others - {*OF_C, *OF_POSIX} == set()
