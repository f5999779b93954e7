"""Compute rates, delays and problems of received transforms, without a node, and describe them as text."""

__all__: list[str] = []
