# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Run the jobs of the GitHub workflows here: `python -m release.run_workflows [--list] [WORD…]`.

Each job gets a fresh clone of the last commit, and runs its steps in order. Artifacts go from job to job.
What this machine cannot do is reported: other systems, containers, publishing, and what others' actions do.
Steps that install packages of the system are left out.
"""

import argparse
import itertools
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from release.child_environment import environment_of_children
from release.interpreters import interpreters

ROOT = Path(__file__).resolve().parent.parent
EXPRESSION = re.compile(r"\$\{\{\s*(.*?)\s*\}\}")
# What an expression means in a run by hand; those of the matrix are known, too.
BY_HAND = {"github.ref_type == 'tag' && github.ref_name || ''": ""}
RUNNER = "ubuntu-24.04"


class Unavailable(Exception):
    """What a job needs and this machine has not."""


@dataclass(eq=False)
class Job:
    """A job of a workflow, for one combination of its matrix."""

    workflow: str
    name: str
    text: dict
    matrix: dict
    needs: list[str] = field(default_factory=list)

    def __str__(self):
        values = f" ({', '.join(self.matrix.values())})" if self.matrix else ""
        return f"{self.workflow} {self.name}{values}"


def jobs_of(path):
    """The jobs of a workflow, those that others need first."""
    found = []
    for name, text in yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].items():
        needs = text.get("needs", [])
        needs = [needs] if isinstance(needs, str) else needs
        found += [Job(path.name, name, text, one, needs) for one in _combinations(text)]
    return sorted(found, key=lambda job: len(job.needs))


def _combinations(text):
    matrix = {**text.get("strategy", {}).get("matrix", {})}
    included = matrix.pop("include", [])
    product = [dict(zip(matrix, one, strict=True)) for one in itertools.product(*matrix.values())]
    return product + included


class Run:
    """A job that runs in a folder of its own."""

    def __init__(self, job, folder, artifacts, root=ROOT):
        self.job, self.root, self.artifacts = job, root, artifacts
        self.workspace, self.python = folder / "workspace", folder / "python"
        self.workspace.mkdir(parents=True)
        self.environment = environment_of_children(CI="true", GITHUB_WORKSPACE=str(self.workspace))
        for name in ("PYTHONPATH", "VIRTUAL_ENV", "MAKEFLAGS", "MAKELEVEL"):
            self.environment.pop(name, None)

    def refuse(self):
        """Raise if this machine cannot run the job."""
        text = self.job.text
        for key in ("container", "environment"):
            if key in text:
                raise Unavailable(f"{key} {self._filled_in(str(text[key]))}")
        if (runner := self._filled_in(text["runs-on"])) != RUNNER:
            raise Unavailable(f"a machine with {runner}")
        for step in text["steps"]:
            action = step.get("uses", "").partition("@")[0]
            if action and action not in self.ACTIONS:
                raise Unavailable(f"the action {action}")

    def steps(self):
        """Run the steps; return the first that fails, or None."""
        if "pip" in self._scripts():  # GitHub's machines have it
            self._set_up_python({})
        for step in self.job.text["steps"]:
            options = {name: self._filled_in(str(value)) for name, value in step.get("with", {}).items()}
            if "uses" in step:
                self.ACTIONS[step["uses"].partition("@")[0]](self, options)
                continue
            script = self._filled_in(step["run"])
            title = step.get("name", script.splitlines()[0])
            if "apt-get" in script:
                print(f"  left out: {title}")
                continue
            print(f"  {title}", flush=True)
            variables = {name: self._filled_in(str(value)) for name, value in step.get("env", {}).items()}
            folder = self.workspace / step.get("working-directory", ".")
            command = ["bash", "-eo", "pipefail", "-c", script]
            if subprocess.run(command, cwd=folder, env={**self.environment, **variables}).returncode:
                return title
        return None

    def _scripts(self):
        return "\n".join(step.get("run", "") for step in self.job.text["steps"])

    def _filled_in(self, text):
        def value(found):
            known = {f"matrix.{name}": value for name, value in self.job.matrix.items()}
            known |= {"github.workspace": str(self.workspace), **BY_HAND}
            if found[1] not in known:
                raise Unavailable(f"a value for {found[1]}")
            return known[found[1]]

        return EXPRESSION.sub(value, text)

    def _check_out(self, options):
        place = self.workspace / options.get("path", ".")
        subprocess.run(["git", "clone", "--quiet", self.root, place], check=True)

    def _set_up_python(self, options):
        version = options.get("python-version", f"{sys.version_info[0]}.{sys.version_info[1]}")
        interpreter = interpreters()[version]
        if interpreter is None:
            raise Unavailable(f"Python {version}")
        shutil.rmtree(self.python, ignore_errors=True)
        subprocess.run([interpreter, "-m", "venv", self.python], check=True)
        if "pipx" in self._scripts():
            subprocess.run([self.python / "bin" / "pip", "install", "--quiet", "pipx"], check=True)
        self.environment["PATH"] = f"{self.python / 'bin'}{os.pathsep}{os.environ['PATH']}"

    def _upload(self, options):
        pattern = Path(options["path"])
        fixed = list(itertools.takewhile(lambda part: "*" not in part, pattern.parts))
        place = self.workspace.joinpath(*fixed)
        for file in self.workspace.glob(str(pattern)):
            target = self.artifacts / options["name"] / file.relative_to(place)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, target)
        if not (self.artifacts / options["name"]).exists():
            raise FileNotFoundError(f"nothing matches {pattern}")

    def _download(self, options):
        for folder in self.artifacts.glob(options.get("pattern", options.get("name", "*"))):
            shutil.copytree(folder, self.workspace / options.get("path", "."), dirs_exist_ok=True)

    ACTIONS = {
        "actions/checkout": _check_out,
        "actions/setup-python": _set_up_python,
        "actions/upload-artifact": _upload,
        "actions/download-artifact": _download,
    }


def run(jobs, root=ROOT):
    """Run jobs; by each, what became of it."""
    results = {}
    with tempfile.TemporaryDirectory(prefix="tf2-ros-cython-jobs-") as folder:
        for number, job in enumerate(jobs):
            begin = time.monotonic()
            print(f"+ {job}", flush=True)
            one = Run(job, Path(folder, str(number)), Path(folder, "artifacts"), root)
            try:
                one.refuse()
                failed = one.steps()
            except Unavailable as error:
                results[job] = f"not run: needs {error}"
            else:
                result = f"failed at {failed!r}" if failed else "passed"
                results[job] = f"{result} after {time.monotonic() - begin:.0f} s"
            shutil.rmtree(Path(folder, str(number)))
    return results


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="python -m release.run_workflows", description=__doc__)
    parser.add_argument(
        "words", nargs="*", metavar="WORD", help="only the jobs with one of these in their names"
    )
    parser.add_argument("--list", action="store_true", help="list the jobs")
    options = parser.parse_args(arguments)
    paths = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
    jobs = [job for path in paths for job in jobs_of(path)]
    jobs = [job for job in jobs if not options.words or any(word in str(job) for word in options.words)]
    if options.list:
        print(*jobs, sep="\n")
        return 0
    results = run(jobs)
    print(*(f"{str(job)}: {result}" for job, result in results.items()), sep="\n")
    return 1 if any(result.startswith("failed") for result in results.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
