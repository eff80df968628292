"""A finished study: tables, front, pictures, words."""
