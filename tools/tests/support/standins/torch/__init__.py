"""Stands in for torch, which has a gigabyte: the part that a page of the documentation uses."""
