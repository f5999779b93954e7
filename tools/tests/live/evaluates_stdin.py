# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs the Python that its standard input orders, a line of JSON for each, and answers with what came out."""

import json
import sys
import traceback


def main():
    names = {}
    for line in sys.stdin:
        order = json.loads(line)
        try:
            value = eval(order, names) if is_expression(order) else exec(order, names)
            answer = {"value": value}
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}", "traceback": traceback.format_exc()}
        print(json.dumps(answer), flush=True)


def is_expression(text):
    try:
        compile(text, "order", "eval")
    except SyntaxError:
        return False
    return True


if __name__ == "__main__":
    main()
