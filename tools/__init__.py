"""Programs for those who work on the project, none of which is installed with it."""
