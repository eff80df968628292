"""Exact search: the strongest segmentation as one mixed-integer linear program, with a proven bound."""
