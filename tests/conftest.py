"""The fixtures and options of the tests are those of tests/support/suite.py, which the tools' tests share."""

pytest_plugins = ["suite", "fastdds_log"]
