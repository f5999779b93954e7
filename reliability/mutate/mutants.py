"""Owns which mutants a source has, and the source that holds all of them, for a program to choose one."""

import re
import tokenize
from collections import Counter
from dataclasses import dataclass

from .expressions import Node, Parser, Unreadable, statements

CIMPORT = "from reliability.mutate.switch cimport mutated as _mutated\n"

_OTHER_OPERATOR = {
    "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==",
    "is": "is not", "is not": "is", "in": "not in", "not in": "in",
    "and": "or", "or": "and", "not": "not not",
    "+": "-", "-": "+", "*": "+", "/": "*", "//": "*", "%": "+",
    "<<": ">>", ">>": "<<", "&": "|", "|": "&", "^": "&",
    "min": "max", "max": "min", "True": "False", "False": "True",
}  # fmt: skip
_OTHER_ASSIGNMENT = {
    "+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "|=": "&=", "&=": "|=", "<<=": ">>=", ">>=": "<<=",
}  # fmt: skip
_INTEGERS = {"int", "size_t", "Py_ssize_t", "uint8_t", "uint32_t", "uint64_t", "int64_t", "FrameId", "double"}
_DECLARED_FUNCTION = re.compile(r"c(?:p)?def\s+(?:inline\s+)?(?P<type>.*?)\b(?P<name>\w+)\(")
# Without effect by definition.
_HINTS = {"__builtin_prefetch"}


@dataclass(frozen=True)
class Mutant:
    """
    One small change of one statement.

    ``key`` tells it from all others of the sources, and stays the same when lines move: file, function, the
    statement before and after, and how many alike come before it in the function.
    """

    number: int
    line: int
    key: tuple[str, str, str, str, int]

    @property
    def file(self):
        return self.key[0]

    def diff(self):
        """The change as text."""
        file, function, before, after, same = self.key
        again = f" #{same + 1}" if same else ""
        return f"{file} {function}{again}\n- {before}\n" + (f"+ {after}\n" if after else "+\n")


class Source:
    """One file with all its mutants, numbered from ``first`` on; ``left_out``: functions without any."""

    def __init__(self, name, text, first, left_out=()):
        self.mutants = []
        self.name = name
        self._text = text
        self._next = first
        self._left_out = left_out
        self._seen = Counter()
        self._function = None
        self._type = ""
        self._edits = []  # (start, end, text) of the mutated source
        self._read()

    def mutated(self):
        """The source with a choice at each place that has mutants."""
        pieces, at = [], 0
        for start, end, text in self._edits:
            pieces += [self._text[at:start], text]
            at = end
        pieces.append(self._text[at:])
        text = "".join(pieces)
        # Behind the docstring.
        match = re.match(r'\s*""".*?"""\n', text, re.DOTALL)
        at = match.end() if match else 0
        return text[:at] + CIMPORT + text[at:]

    # Statements.

    def _read(self):
        indents = []  # of the function and of what it is in
        for tokens in statements(self._text):
            start = tokens[0].start
            indent = start - (self._text.rfind("\n", 0, start) + 1)
            if self._function is not None and indent <= indents[-1]:
                self._function = None
            header = self._function_of(tokens)
            if header is not None and self._function is None:
                self._function, self._type = header
                indents.append(indent)
            elif self._function is not None and self._function not in self._left_out:
                self._statement(tokens, indent)

    def _function_of(self, tokens):
        text = self._text[tokens[0].start : tokens[-1].end]
        if not text.endswith(":") or tokens[0].text not in {"cdef", "cpdef", "def"}:
            return None
        if tokens[0].text == "def":
            return tokens[1].text, "object"
        if tokens[1].text in {"class", "struct", "extern"}:
            return None
        match = _DECLARED_FUNCTION.match(text)
        return None if match is None else (match["name"], match["type"].strip())

    def _statement(self, tokens, indent):
        self._line = tokens
        word = tokens[0].text
        if word in {"if", "elif", "while"}:
            self._condition(tokens[1:-1])
        elif word == "for":
            texts = [token.text for token in tokens]
            self._expression(tokens[texts.index("in") + 1 : -1])
        elif word == "return" and len(tokens) > 1:
            self._return(tokens, indent)
        elif word in {"return", "break", "continue"}:
            self._removable(tokens, indent, [], "" if word == "return" else "pass")
        elif word == "cdef":
            equals = _at_depth_0(tokens, {"="})
            if equals is not None:
                self._expression(tokens[equals + 1 :])
        elif word not in _NOT_MUTATED and tokens[-1].text != ":" and tokens[0].kind != tokenize.STRING:
            self._assignment_or_call(tokens, indent)

    def _assignment_or_call(self, tokens, indent):
        if tokens[0].text in _HINTS:
            return
        augmented = _at_depth_0(tokens, set(_OTHER_ASSIGNMENT))
        equals = _at_depth_0(tokens, {"="}, last=True)
        if augmented is not None:
            operator = tokens[augmented]
            edit = (operator.start, operator.end, _OTHER_ASSIGNMENT[operator.text])
            self._removable(tokens, indent, tokens[augmented + 1 :], edits=[edit])
        else:
            self._removable(tokens, indent, tokens if equals is None else tokens[equals + 1 :])

    def _removable(self, tokens, indent, expression, instead="", edits=()):
        # The statement, without it, and with other edits of it: as branches of one `if`.
        start, end = tokens[0].start, tokens[-1].end
        body = self._with_choices(expression) if expression else []
        margin = " " * indent
        removed = self._add([(start, end, instead)])
        text = "if "
        for edit in edits:
            edited = self._edited(start, end, [edit])
            text += f"_mutated({self._add([edit])}):\n{margin}    {edited}\n{margin}elif "
        text += f"not _mutated({removed}):\n{margin}    {self._edited(start, end, body)}"
        self._edits.append((start, end, text))

    def _condition(self, tokens):
        node = self._parsed(tokens)
        if node is not None:
            self._edits.append((node.start, node.end, self._truth(node)))

    def _expression(self, tokens):
        self._edits += self._with_choices(tokens)

    def _return(self, tokens, indent):
        node = self._parsed(tokens[1:])
        if node is None:
            return
        plain = self._text[node.start : node.end]
        wrapped = self._truth(node) if self._type == "bint" else self._choices(node)
        literal = node.kind in {"number", "truth"} or plain in {"NULL", "None"} or plain.startswith("-1")
        instead = None
        if not literal and self._type in _INTEGERS:
            instead = f"({plain}) + 1"
        elif not literal and self._type.endswith("*"):
            instead = "NULL"
        elif not literal and self._type in {"object", "list", "dict", "str", "tuple"}:
            instead = "None"
        if instead is not None:
            number = self._add([(node.start, node.end, instead)])
            margin = " " * indent
            text = f"if _mutated({number}):\n{margin}    return {instead}\n{margin}"
            self._edits.append((tokens[0].start, tokens[0].start, text))
        self._edits.append((node.start, node.end, wrapped))

    # Expressions.

    def _parsed(self, tokens):
        try:
            return Parser(tokens).whole()
        except Unreadable:
            return None

    def _with_choices(self, tokens):
        node = self._parsed(tokens)
        return [] if node is None else [(node.start, node.end, self._choices(node))]

    def _truth(self, node):
        # As _choices, where only whether it is true matters; and with the negation.
        wrapped = self._choices(node)
        negated_anyway = node.kind in {"not", "truth"} or (
            node.kind == "compare" and len(node.operators) == 1 and node.operators[0].text not in "<= >= < >"
        )
        if negated_anyway:
            return wrapped
        edits = [(node.start, node.start, "not ("), (node.end, node.end, ")")]
        return _either(self._add(edits), self._edited(node.start, node.end, edits), wrapped)

    def _choices(self, node: Node):
        """The text of an expression with a choice at each operator and constant in it."""
        inner = []
        for child in node.children:
            text = self._truth(child) if child is node.condition else self._choices(child)
            inner.append((child.start, child.end, text))
        wrapped = self._edited(node.start, node.end, inner)
        for operator in node.operators:
            edit = (operator.start, operator.end, self._other(node, operator))
            mutated = self._edited(node.start, node.end, [edit])
            number = self._add([edit])
            if node.kind in {"boolean", "not"}:
                wrapped = _either(number, mutated, wrapped)
            else:
                wrapped = f"(({mutated}) if _mutated({number}) else ({wrapped}))"
        return wrapped

    def _other(self, node, operator):
        if node.kind == "number":
            number = operator.text
            return str(float(number) + 1.0) if "." in number or "e" in number else str(int(number, 0) + 1)
        if node.kind == "unary":
            return ""
        return _OTHER_OPERATOR[operator.text]

    # Text.

    def _edited(self, start, end, edits):
        pieces, at = [], start
        for edit_start, edit_end, text in sorted(edits, key=lambda edit: edit[:2]):
            pieces += [self._text[at:edit_start], text]
            at = edit_end
        return "".join(pieces) + self._text[at:end]

    def _add(self, edits):
        start, end = self._line[0].start, self._line[-1].end
        before, after = (_one_line(text) for text in (self._text[start:end], self._edited(start, end, edits)))
        same = (self._function, before, after)
        number = self._next
        self._next += 1
        line = self._text.count("\n", 0, start) + 1
        key = (self.name, self._function, before, after, self._seen[same])
        self._seen[same] += 1
        self.mutants.append(Mutant(number, line, key))
        return number


_NOT_MUTATED = {
    "pass", "else", "try", "finally", "with", "except", "raise", "def", "cpdef", "class", "from", "import",
    "cimport", "global", "@", "assert", "del",
}  # fmt: skip


def _either(number, mutated, wrapped):
    # Not a conditional expression: the operands may be of several types, pointers among them.
    return f"((_mutated({number}) and ({mutated})) or (not _mutated({number}) and ({wrapped})))"


def _one_line(text):
    text = re.sub(r"#.*", "", text)
    return re.sub(r"\s+", " ", text.replace("\\\n", " ")).strip()


def _at_depth_0(tokens, texts, last=False):
    depth, found = 0, None
    for i, token in enumerate(tokens):
        depth += token.text in {"(", "[", "{"}
        depth -= token.text in {")", "]", "}"}
        if depth == 0 and token.text in texts and (last or found is None):
            found = i
    return found
