"""How often tests repeat what depends on chance: less in `make test` than in `make test-all`."""

all_of_them = False  # whether it is `pytest --all`; set before tests are imported


def times(few, many):
    """One of these numbers: `many` of `pytest --all`, otherwise `few`."""
    return many if all_of_them else few
