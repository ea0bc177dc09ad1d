"""Checks of the project's structure: each takes a folder and says what breaks a rule there.

None of them imports what it checks. tests/structure/ runs them on the project, and on small trees
of files in which they have to find something.
"""
