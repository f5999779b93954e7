"""Owns the program that says whether the transforms of a robot are as they must be."""

import sys
from argparse import Namespace
from collections.abc import Collection, Mapping, Sequence
from xml.etree import ElementTree

from tf2_py._internal import printable
from tf2_ros._traffic import expectations
from tf2_ros._traffic.expectations import Expectation
from tf2_ros._traffic.findings import KINDS, Finding, Limits
from tf2_ros.cli._listening import Report, listening
from tf2_ros.cli._node import spun_node
from tf2_ros_cython.cli._program import FAILURE, SUCCESS, UsageError
from tf2_ros_cython.cli.tf2_check import main

__all__ = ["check", "main"]


def check(options: Namespace) -> int:
    """Listen, print what is wrong, and return the exit status."""
    expected = _expectations(options.expect)
    unknown = set(options.ignore) - KINDS.keys()
    if unknown:
        raise UsageError(f"--ignore: {min(unknown)} is none of {', '.join(KINDS)}")
    with spun_node("tf2_check", options) as node, listening(node) as heard:
        heard.listen(options.t)
        report = heard.report(Limits(min_rate=options.min_rate), expected)
    wrong = [finding for finding in report.findings if finding.kind not in options.ignore]
    _print(report, wrong, options.t)
    if options.junit is not None:
        _write_junit(options.junit, wrong, options.ignore, options.t)
    return FAILURE if wrong else SUCCESS


def _expectations(path: str | None) -> Mapping[str, Expectation]:
    if path is None:
        return {}
    try:
        return expectations.read(path)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None


def _print(report: Report, wrong: Sequence[Finding], seconds: float) -> None:
    for finding in wrong:
        print(f"{finding.kind}: {printable(finding.text)}")
    frames = len({stream.frame for stream in report.streams})
    print(f"{'wrong' if wrong else 'ok'}: {frames} frames in {report.messages} messages and {seconds:g} s")
    for count, what in (
        (report.lost, "transforms arrived too fast to be checked"),
        (report.malformed, "messages could not be read"),
    ):
        if count:
            print(f"{count} {what}", file=sys.stderr)


def _write_junit(path: str, wrong: Sequence[Finding], ignored: Collection[str], seconds: float) -> None:
    kinds = {finding.kind for finding in wrong}
    counts = {"tests": len(KINDS), "failures": len(kinds), "errors": 0, "skipped": len({*ignored})}
    attributes = {name: str(value) for name, value in counts.items()}
    suite = ElementTree.Element("testsuite", {"name": "tf2_check", "time": f"{seconds:g}", **attributes})
    for kind, meaning in KINDS.items():
        case = ElementTree.SubElement(suite, "testcase", classname="tf2_check", name=kind)
        # XML has no way to write most control characters.
        texts = [printable(finding.text) for finding in wrong if finding.kind == kind]
        if texts:
            ElementTree.SubElement(case, "failure", message=meaning).text = "\n".join(texts)
        elif kind in ignored:
            ElementTree.SubElement(case, "skipped")
    try:
        ElementTree.ElementTree(suite).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None


if __name__ == "__main__":
    sys.exit(main())
