"""One plug-in of each kind, written against exported names only."""
