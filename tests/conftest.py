"""Fixtures and options are those of tests/support/suite_fixtures.py, which the tools' tests share."""

pytest_plugins = ["suite_fixtures", "fastdds_log"]
