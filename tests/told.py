"""A `Progress` that remembers what it was told."""

from contextlib import contextmanager


class Told:
    """stages: title -> what was told inside, how much is done and a note, with titles of inner stages before it.

    notes: what was told outside of all stages; said: the lines that stay.
    """

    def __init__(self):
        self.stages = {}
        self.notes = []
        self.said = []

    @contextmanager
    def stage(self, title, total=None):
        notes = self.stages.setdefault(title, [])
        yield _Part(self, notes, "")

    def at(self, done, note=""):
        self.notes.append((done, note))

    def say(self, line):
        self.said.append(line)

    def done_before(self, title):
        return [note for _, note in self.stages[title]] == ["done before"]


class _Part:
    def __init__(self, told, notes, before):
        self.told, self.notes, self.before = told, notes, before

    @contextmanager
    def stage(self, title, total=None):
        yield _Part(self.told, self.notes, f"{self.before}{title}: ")

    def at(self, done, note=""):
        self.notes.append((done, self.before + note if note else ""))

    def say(self, line):
        self.told.say(line)
