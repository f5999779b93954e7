# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Coverage-guided fuzzing: `python -m reliability.fuzz --help`.

A target is a module of :mod:`reliability.fuzz.targets` with a function ``run(data)``, which takes any bytes
and raises what shows a fault. It needs no fuzzer: tests/packaging/test_fuzz_corpus.py runs it with
what its archive in ``corpus/`` holds.
"""
