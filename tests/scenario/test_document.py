import pytest

from flightcal.scenario.document import parse_document, read_document


def test_yaml_1_2_leaves_words_and_times_alone():
    text = "[18:00, on, off, no, yes, n, 2024-03-01T00:00:00, 012, 1_000, 0x1f, 0o17, 1e3, .5, ~, null, true, '3', =]"
    expected = [
        *("18:00", "on", "off", "no", "yes", "n", "2024-03-01T00:00:00"),
        *(12, 1000, 31, 15, 1000.0, 0.5, None, None, True, "3", "="),
    ]

    assert parse_document(text).data == expected


def test_yaml_1_1_directive_mangles_nothing_either():
    assert parse_document("%YAML 1.1\n---\n{on: off, t: 18:00}").data == {"on": "off", "t": "18:00"}


def test_every_key_and_item_has_its_line():
    document = parse_document("a: 1\nb:\n  c: {d: 1,\n    e: 2}\n  f:\n    - x\n    - y\n")

    lines = {".".join(map(str, location)): line for location, line in document.lines.items()}
    assert lines == {"": 1, "a": 1, "b": 2, "b.c": 3, "b.c.d": 3, "b.c.e": 4, "b.f": 5, "b.f.0": 6, "b.f.1": 7}
    assert document.line(("b", "c", "missing", "deeper")) == 3


def test_duplicate_key_is_a_problem_on_its_own_line_and_the_first_value_stays():
    document = parse_document("a: 1\nb: 2\na: 3\n")

    assert document.data == {"a": 1, "b": 2}
    assert [(problem.location, problem.line) for problem in document.problems] == [(("a",), 3)]
    assert document.problems[0].message == "found the key twice, first on line 1"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("a: [1\nb: 2", 2, "expected ',' or ']'"),
        ("a:\n\t- b", 2, "indent with spaces, not tabs"),
        ("a: b: c", 1, "stands in quotes"),
        ("a: 1\n---\nb: 2", 2, "one document"),
        ("a: *b", 1, "undefined alias 'b'"),
        ("a: &x [*x]", None, "an alias contains itself"),
        ("[" * 3000, None, "nested too deeply"),
        ("a: \x00", None, "unacceptable character"),
        ("", 1, "found an empty file, expected a scenario"),
        ("# nothing\n", 1, "found an empty file, expected a scenario"),
        ("{a: b, <<: {c: d}}", 1, "merge keys"),
        ("? [a]\n: b", 1, "found a list or mapping as a key"),
        ("a: !!python/name:os.system x", 1, "found the YAML tag"),
    ],
)
def test_what_is_wrong_as_yaml_is_a_problem_and_not_raised(text, line, message):
    document = parse_document(text)

    assert len(document.problems) == 1
    problem = document.problems[0]
    assert message in problem.message
    assert (problem.line or (document.lines and document.line(problem.location)) or None) == line


def test_aliases_that_multiply_are_cut_off():
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 10)]

    assert "more than 100000 values" in parse_document("\n".join(rows)).problems[0].message


def test_file_that_cannot_be_read_is_a_problem(tmp_path):
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"name: x\ndescription: caf\xe9\n")

    assert read_document(tmp_path / "none.yaml").problems[0].message == "cannot be read: No such file or directory"
    assert read_document(tmp_path).problems[0].message == "found a folder, expected a scenario file"
    assert read_document(latin).problems[0].message == "found the byte 0xe9, expected text encoded as UTF-8"
    assert read_document(latin).problems[0].line == 2


def test_byte_order_mark_is_no_part_of_the_first_key(tmp_path):
    path = tmp_path / "bom.yaml"
    path.write_bytes(b"\xef\xbb\xbfname: x\n")

    assert read_document(path).data == {"name": "x"}
