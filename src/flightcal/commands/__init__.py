"""One module a verb of the command line; the only room that knows all others.

Imports: all rooms.
"""
