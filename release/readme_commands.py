"""
Run the README's commands as a new user would: `python3 release/readme_commands.py`, or `make bare`.

`make demo`, `make test` and `make -C tools demo` run in a new clone of the last commit, with an empty home
and without caches. The only variables are those that say how to reach the network, and the only programs in
PATH are Python, a C compiler and those that every system has. This program needs only Python.
"""

import argparse
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

# What --quick runs of the core's tests: the engine, topics over DDS, and names.
QUICK = """
tests/core/test_lookup.py tests/core/test_recorded_answers.py tests/ros/test_buffer.py
tests/ros/test_receiver.py tests/ros/test_transform_listener.py tests/packaging/test_public_names.py
tests/ros/test_users_programs.py
""".split()


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python3 release/readme_commands.py", description=__doc__.split("\n\n")[1]
    )
    parser.add_argument("--user", help="run as this user; a superuser may ask for it")
    parser.add_argument(
        "--quick", action="store_true", help="run some of the tests, which take a few minutes"
    )
    parser.add_argument("--tests", nargs="+", default=[], metavar="FILE", help="run these tests")
    options = parser.parse_args(arguments)
    chosen = QUICK if options.quick else options.tests
    with tempfile.TemporaryDirectory(prefix="tf2-ros-cython-bare-") as folder:
        place = Path(folder)
        as_user = _prepare(place, options.user)
        test = ["make", "test-core", f"TESTS={' '.join(chosen)}"] if chosen else ["make", "test"]
        for command in (["make", "demo"], test, ["make", "-C", "tools", "demo"]):
            print("+", *command, flush=True)
            ended = subprocess.run([*as_user, *command], cwd=place / "clone", env=_environment(place))
            if ended.returncode:
                print(f"{' '.join(command)} ended with {ended.returncode}")
                return 1
    print("the commands work as a new user would run them")
    return 0


def _prepare(place, user):
    """The clone, a home, a folder of programs; the command that runs another one as the user."""
    subprocess.run(["git", "clone", "--quiet", ROOT, place / "clone"], check=True)
    for folder in ("bin", "home", "tmp"):
        (place / folder).mkdir()
    _link_programs(place / "bin")
    if user is None:
        return []
    runuser = shutil.which("runuser")
    if runuser is None:
        sys.exit("--user needs runuser, of util-linux")
    shutil.chown(place, user)
    for path in place.rglob("*"):
        if not path.is_symlink():
            shutil.chown(path, user)
    # It sets the home of its own accord; a daemon's is none.
    return [runuser, "-u", user, "--", shutil.which("env"), f"HOME={place / 'home'}"]


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
