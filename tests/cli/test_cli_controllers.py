"""thermap export and thermap compare: files that are whole or not there, and what a person sees.

At 25.5 °C of x-middle and 29 °C of z-column the example machine has EXX 27.5 µm at 500 mm and EZZ
70 µm at 500 mm (see `error_map`).
"""

import json

import pytest

from app.cli.controllers import NotWritten, write_files

AT = ("-t", "x-middle=25.5", "-t", "z-column=29")


def lines_with(text, *words):
    return [line for line in text.splitlines() if all(word in line for word in words)]


def test_the_formats_are_listed(thermap):
    found = thermap("controllers")
    assert found.exit_code == 0
    assert lines_with(found.stdout, "linuxcnc", "verified on the running controller")
    assert lines_with(found.stdout, "counts_per_mm (needed)")
    assert len(json.loads(thermap("controllers", "--json").stdout)["controllers"]) == 11


def test_files_are_written_and_found_right(thermap, tmp_path):
    folder = tmp_path / "cnc"
    found = thermap("export", "mcfv5050", "-c", "linuxcnc", "--output", str(folder), *AT)
    assert (found.exit_code, found.stderr) == (0, "")
    assert sorted(path.name for path in folder.iterdir()) == [
        "thermap-check.txt",
        "thermap.ini",
        "x.comp",
        "z.comp",
    ]
    assert (folder / "x.comp").read_bytes() == b"0 0 0\n100 -0.0055 -0.0055\n500 -0.0275 -0.0275\n"
    assert lines_with(found.stdout, "axis", "to [mm]", "by [µm]", "shows")
    assert lines_with(found.stdout, "500", "-27.50", "EXX")
    assert lines_with(found.stdout, "! not held: ", "SXY 12.75 µm")
    files = [str(folder / name) for name in ("x.comp", "z.comp", "thermap.ini")]
    same = thermap("compare", "mcfv5050", *files, "-c", "linuxcnc", *AT)
    assert (same.exit_code, same.stderr) == (0, "")
    assert lines_with(same.stdout, "EXX", "+0.00 µm")
    warm = ("-t", "x-middle=30", "-t", "z-column=29")
    stale = thermap("compare", "mcfv5050", files[0], files[2], "-c", "linuxcnc", *warm)
    assert lines_with(stale.stdout, "EXX", "-22.50 µm", "500")
    assert lines_with(stale.stdout, "EZZ", "-70.00 µm", "not in the files")


def test_a_reason_is_said_once_and_names_its_components(thermap):
    found = thermap("export", "mcfv5050", "-c", "linuxcnc", *AT)
    said = " ".join(found.stdout.split())
    why = "LinuxCNC COMP_FILE has no table for it"
    assert f"! not held: EBX 38.89 µm, SXY 12.75 µm at most; {why}" in said
    assert said.count(why) == 1


def test_what_is_there_is_not_replaced_unasked(thermap, tmp_path):
    (tmp_path / "x.comp").write_text("mine")
    again = ("export", "mcfv5050", "-c", "linuxcnc", "--output", str(tmp_path), *AT)
    found = thermap(*again)
    assert found.exit_code == 1
    assert "x.comp" in found.stderr
    assert "nothing was written" in found.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["x.comp"]
    assert (tmp_path / "x.comp").read_text() == "mine"
    assert thermap(*again, "--overwrite").exit_code == 0
    assert (tmp_path / "x.comp").read_text().startswith("0 0 0\n")


def test_nothing_is_written_where_one_file_cannot_be(tmp_path):
    (tmp_path / "b").mkdir()
    files = {"a": "a", "b": "b"}
    with pytest.raises(NotWritten, match=r"b in .* is a folder"):
        write_files(tmp_path, files, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_no_name_leads_out_of_the_folder(tmp_path):
    with pytest.raises(NotWritten, match="expected names inside"):
        write_files(tmp_path / "in", {"../a": "a"})
    assert list(tmp_path.iterdir()) == []


def test_a_refused_export_writes_nothing_and_says_why(thermap, tmp_path):
    folder = tmp_path / "cec"
    found = thermap("export", "mcfv5050", "-c", "siemens-cec", "--output", str(folder), *AT)
    assert found.exit_code == 1
    assert "options.sign: expected a value" in found.stderr
    assert not folder.exists()


def test_options_and_bands(thermap, tmp_path):
    found = thermap(
        "export", "mcfv5050", "-c", "siemens-cec", "--output", str(tmp_path),
        "-o", "sign=compensation", "-o", 'axes={"x": "MX", "y": "MY", "z": "MZ"}',
        "--from", "x-middle=20", "--from", "z-column=22",
        "--to", "x-middle=30", "--to", "z-column=32", "--step", "50",
    )  # fmt: skip
    assert (found.exit_code, found.stderr) == (0, "")
    assert lines_with(found.stdout, "band-01", "x-middle 20.00 to 25.00")
    content = (tmp_path / "band-02" / "N_NC_CEC_INI.INI").read_text()
    assert "_INPUT_AXIS[3]=(MX)" in content
    assert thermap("export", "mcfv5050", "-c", "fanuc", "--step", "5", *AT).exit_code == 2


def test_a_file_that_cannot_be_read_is_told(thermap, tmp_path):
    found = thermap("compare", "mcfv5050", str(tmp_path / "no.comp"), "-c", "linuxcnc", *AT)
    assert found.exit_code == 2
    assert "cannot read" in found.stderr
