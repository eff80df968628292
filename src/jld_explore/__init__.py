"""Many labellings of one assembly: which to try, what they must satisfy, and what was found."""
