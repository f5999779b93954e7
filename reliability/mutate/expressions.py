"""Owns reading Cython expressions: where each operator, constant and operand stands in the source."""

import io
import tokenize
from dataclasses import dataclass, field

_LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
_COMPARISONS = {"<", "<=", ">", ">=", "==", "!="}
# By how closely they bind, the loosest first.
_BINARY = ({"|"}, {"^"}, {"&"}, {"<<", ">>"}, {"+", "-"}, {"*", "/", "//", "%"})
# What stands in their parentheses is a type, or the size of memory.
_OPAQUE = {"sizeof", "malloc", "calloc", "realloc", "lambda"}


class Unreadable(ValueError):
    """An expression of a kind that this parser does not know."""


@dataclass(frozen=True)
class Token:
    """One token, from offset ``start`` to ``end`` of the source."""

    kind: int
    text: str
    start: int
    end: int


@dataclass
class Node:
    """
    One expression.

    ``kind`` is ``"compare"``, ``"boolean"``, ``"not"``, ``"binary"``, ``"unary"``, ``"number"``, ``"truth"``,
    ``"call"``, ``"choice"`` or ``"other"``; ``operators`` are its own tokens that a mutation may replace.
    """

    kind: str
    start: int
    end: int
    children: list["Node"] = field(default_factory=list)
    operators: list[Token] = field(default_factory=list)
    condition: "Node | None" = None  # of a choice


def statements(text):
    """Yield each logical line of a source as its tokens."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    tokens = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NEWLINE:
            if tokens:
                yield tokens
            tokens = []
        elif token.type not in _LAYOUT:
            start = starts[token.start[0] - 1] + token.start[1]
            tokens.append(Token(token.type, token.string, start, starts[token.end[0] - 1] + token.end[1]))


class Parser:
    """Reads one expression from some tokens; what follows it is left."""

    def __init__(self, tokens):
        self._tokens = tokens
        self._next = 0

    def whole(self):
        """The node of an expression that takes all tokens."""
        node = self._tuple()
        if self._next != len(self._tokens):
            raise Unreadable(self._tokens[self._next].text)
        return node

    def _text(self):
        return self._tokens[self._next].text if self._next < len(self._tokens) else ""

    def _take(self, *texts):
        if self._next == len(self._tokens) or (texts and self._text() not in texts):
            raise Unreadable(self._text())
        self._next += 1
        return self._tokens[self._next - 1]

    def _tuple(self):
        items = [self._choice()]
        while self._text() == ",":
            end = self._take().end
            if self._next == len(self._tokens) or self._text() in {")", "]", "="}:
                return Node("other", items[0].start, end, items)
            items.append(self._choice())
        return items[0] if len(items) == 1 else Node("other", items[0].start, items[-1].end, items)

    def _choice(self):
        value = self._or()
        if self._text() != "if":
            return value
        self._take()
        condition = self._or()
        self._take("else")
        other = self._choice()
        return Node("choice", value.start, other.end, [value, condition, other], condition=condition)

    def _or(self):
        return self._boolean("or", lambda: self._boolean("and", self._not))

    def _boolean(self, word, operand):
        operands, operators = [operand()], []
        while self._text() == word:
            operators.append(self._take())
            operands.append(operand())
        if not operators:
            return operands[0]
        return Node("boolean", operands[0].start, operands[-1].end, operands, operators)

    def _not(self):
        if self._text() != "not":
            return self._compare()
        word = self._take()
        operand = self._not()
        return Node("not", word.start, operand.end, [operand], [word])

    def _compare(self):
        operands, operators = [self._binary(0)], []
        while True:
            if self._text() in _COMPARISONS:
                operators.append(self._take())
            elif self._text() in {"is", "in", "not"}:
                first = last = self._take()
                if self._text() in {"not", "in"} and first.text != "in":
                    last = self._take()
                words = first.text if first is last else f"{first.text} {last.text}"
                operators.append(Token(first.kind, words, first.start, last.end))
            else:
                break
            operands.append(self._binary(0))
        if not operators:
            return operands[0]
        return Node("compare", operands[0].start, operands[-1].end, operands, operators)

    def _binary(self, level):
        if level == len(_BINARY):
            return self._unary()
        left = self._binary(level + 1)
        while self._text() in _BINARY[level]:
            operator = self._take()
            right = self._binary(level + 1)
            left = Node("binary", left.start, right.end, [left, right], [operator])
        return left

    def _unary(self):
        if self._text() in {"-", "~", "&"}:
            operator = self._take()
            operand = self._unary()
            operators = [] if operator.text == "&" else [operator]
            return Node("unary", operator.start, operand.end, [operand], operators)
        if self._text() == "<":
            start = self._take().start
            while self._text() != ">":
                self._take()
            self._take(">")
            operand = self._unary()
            return Node("other", start, operand.end, [operand])
        return self._postfix()

    def _postfix(self):
        node = self._atom()
        while self._text() in {".", "(", "["}:
            opening = self._take()
            if opening.text == ".":
                node = Node("other", node.start, self._take().end, [node])
            elif opening.text == "[":
                items = self._items("]")
                node = Node("other", node.start, self._take("]").end, [node, *items])
            else:
                name = self._tokens[self._next - 2]
                if name.text in _OPAQUE:
                    self._skip_to_closing()
                    node = Node("other", node.start, self._tokens[self._next - 1].end)
                    continue
                items = self._items(")")
                own = [name] if name.text in {"min", "max"} else []
                node = Node("call", node.start, self._take(")").end, [node, *items], own)
        return node

    def _skip_to_closing(self):
        depth = 1
        while depth:
            depth += {"(": 1, ")": -1}.get(self._take().text, 0)

    def _items(self, closing):
        items = []
        while self._text() != closing:
            if self._text() in {",", ":", "*", "**"}:
                self._take()
            elif self._next + 1 < len(self._tokens) and self._tokens[self._next + 1].text == "=":
                self._take()
                self._take("=")
            else:
                items.append(self._choice())
        return items

    def _atom(self):
        token = self._take()
        if token.text in {"(", "["}:
            closing = {"(": ")", "[": "]"}[token.text]
            items = self._items(closing)
            return Node("other", token.start, self._take(closing).end, items)
        if token.kind == tokenize.NUMBER:
            return Node("number", token.start, token.end, operators=[token])
        if token.text in {"True", "False"}:
            return Node("truth", token.start, token.end, operators=[token])
        if token.kind == tokenize.STRING:
            end = token.end
            while self._next < len(self._tokens) and self._tokens[self._next].kind == tokenize.STRING:
                end = self._take().end
            return Node("other", token.start, end)
        if token.kind == tokenize.NAME and token.text not in {"lambda", "for", "yield", "await"}:
            return Node("other", token.start, token.end)
        raise Unreadable(token.text)
