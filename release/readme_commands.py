# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Run the README's commands as a new user would: `python3 release/readme_commands.py`, or `make bare`.

`make demo`, `make test` and `make -C tools demo` run in a new clone of the last commit, with an empty home
and without caches. The only variables are those that say how to reach the network, and the only programs in
PATH are Python, a C compiler and those that every system has. This program needs only Python.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

# What a C compiler comes with, and what a base system has.
COMPILERS = ("cc", "gcc", "g++", "c++", "ld", "as", "ar", "make", "git")
SYSTEM = """
[ basename bash cat chmod chown cp cut date df dirname echo env expr false find grep head hostname id
install kill ldconfig ldd ln ls mkdir mktemp mount mv nice nproc od printf ps pwd readlink realpath rm rmdir
sed setsid sh sleep sort stat stty tail tar tee test timeout touch tr true tty uname uniq unshare wc which
xargs
""".split()
# How this machine reaches package registries.
NETWORK = ("http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY")
CERTIFICATES = ("SSL_CERT_FILE", "SSL_CERT_DIR", "REQUESTS_CA_BUNDLE")


def main():
    with tempfile.TemporaryDirectory(prefix="tf2-ros-cython-bare-") as folder:
        place = Path(folder)
        subprocess.run(["git", "clone", "--quiet", ROOT, place / "clone"], check=True)
        for name in ("bin", "home", "tmp"):
            (place / name).mkdir()
        _link_programs(place / "bin")
        for command in (["make", "demo"], ["make", "test"], ["make", "-C", "tools", "demo"]):
            print("+", *command, flush=True)
            ended = subprocess.run(command, cwd=place / "clone", env=_environment(place))
            if ended.returncode:
                print(f"{' '.join(command)} ended with {ended.returncode}")
                return 1
    print("the commands work as a new user would run them")
    return 0


def _link_programs(folder):
    """Make the folder a PATH: this Python, compilers, and what every system has."""
    for name in {*COMPILERS, *_compilers_of_python(), *SYSTEM}:
        found = shutil.which(name)
        if found:
            (folder / name).symlink_to(Path(found).absolute())
    # Not a link: Python finds its library beside the file that it was started from.
    (folder / "python3").write_text(f'#!/bin/sh\nexec "{sys._base_executable}" "$@"\n')
    (folder / "python3").chmod(0o755)


def _compilers_of_python():
    """The names of the compilers that Python was built with; what builds an extension asks for them."""
    commands = (sysconfig.get_config_var(name) or "" for name in ("CC", "CXX"))
    return {command.split()[0] for command in commands if command and "/" not in command.split()[0]}


def _environment(place):
    kept = {
        name: value
        for name, value in os.environ.items()
        if name in (*NETWORK, *CERTIFICATES) or name.startswith("PIP_")  # which registry, above all
    }
    return {
        **kept,
        "HOME": str(place / "home"),
        "TMPDIR": str(place / "tmp"),
        "PATH": str(place / "bin"),
        "LANG": "C.UTF-8",
        "PIP_NO_CACHE_DIR": "1",
    }


if __name__ == "__main__":
    sys.exit(main())
