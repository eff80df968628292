"""The conic program of one labelling, and what a relabelling changes in it."""
