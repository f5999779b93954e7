"""Owns saying what was found wrong: options, lines, and JUnit's XML."""

from argparse import Namespace
from collections.abc import Collection, Mapping, Sequence
from xml.etree import ElementTree

from tf2_py._internal import counted, printable
from tf2_ros._traffic import expectations
from tf2_ros._traffic.expectations import Expectation
from tf2_ros._traffic.findings import KINDS, Finding
from tf2_ros._traffic.streams import Stream
from tf2_ros._whole_files import write_whole
from tf2_ros_cython.cli._program import RunError, UsageError

__all__ = ["expected_by", "line_of", "not_ignored", "refuse_unknown_kinds", "verdict_of", "write_junit"]


def expected_by(options: Namespace) -> Mapping[str, Expectation]:
    """
    What the file of ``--expect`` says; nothing without it.

    :raises UsageError: it cannot be read, or says something unknown.
    :raises RunError: PyYAML is not installed.
    """
    path = options.expect
    if path is None:
        return {}
    try:
        return expectations.read(path)
    except ModuleNotFoundError as lack:
        if lack.name != "yaml":
            raise
        raise RunError("--expect needs the Python package PyYAML: pip install PyYAML") from None
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None


def refuse_unknown_kinds(options: Namespace) -> None:
    """Raise a UsageError where ``--ignore`` names a kind that does not exist."""
    unknown = set(options.ignore) - KINDS.keys()
    if unknown:
        raise UsageError(f"--ignore: {min(unknown)} is none of {', '.join(KINDS)}")


def not_ignored(findings: Sequence[Finding], options: Namespace) -> list[Finding]:
    """What is wrong here."""
    return [finding for finding in findings if finding.kind not in options.ignore]


def line_of(finding: Finding) -> str:
    """A finding as a line."""
    return f"{finding.kind}: {printable(finding.text)}"


def verdict_of(wrong: Sequence[Finding], streams: Sequence[Stream], of_what: str) -> str:
    """
    The last line: how many findings there are, in what.

    :param of_what: how much was received, as ``12 messages and 5 s``.
    """
    frames = counted(len({stream.frame for stream in streams}), "frame")
    verdict = f"wrong: {counted(len(wrong), 'finding')}" if wrong else "ok: no findings"
    return f"{verdict} in {frames}, {of_what}"


def write_junit(
    path: str, name: str, wrong: Sequence[Finding], ignored: Collection[str], seconds: float
) -> None:
    """
    Write the result as JUnit's XML, with a test case for each kind of finding.

    :param name: of the suite.
    :param seconds: how long was listened.
    :raises UsageError: it cannot be written; what was there before stays.
    """
    kinds = {finding.kind for finding in wrong}
    counts = {"tests": len(KINDS), "failures": len(kinds), "errors": 0, "skipped": len({*ignored})}
    attributes = {key: str(value) for key, value in counts.items()}
    suite = ElementTree.Element("testsuite", {"name": name, "time": f"{seconds:g}", **attributes})
    for kind, meaning in KINDS.items():
        case = ElementTree.SubElement(suite, "testcase", classname=name, name=kind)
        # XML has no way to write most control characters.
        texts = [printable(finding.text) for finding in wrong if finding.kind == kind]
        if texts:
            ElementTree.SubElement(case, "failure", message=meaning).text = "\n".join(texts)
        elif kind in ignored:
            ElementTree.SubElement(case, "skipped")
    try:
        write_whole(path, ElementTree.tostring(suite, encoding="utf-8", xml_declaration=True))
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
