"""thermap simulate campaign: files that the service takes, and the truth apart from them."""

import json

import pytest

from app.services.observations import VerificationRequest
from app.simulation.undeclared import FAMILIES, UNKNOWN, make_campaign, make_record

SMALL = ("--visits", 8, "--later", 2, "--seed", 5)


def stored(file):
    return json.loads(file.read_text(encoding="utf-8"))


def test_every_effect_of_the_simulator_is_in_the_help(thermap):
    words = thermap("simulate", "campaign", "--help").stdout.replace("│", " ").split()
    for name in (*FAMILIES, *UNKNOWN):
        assert name in "".join(words)


@pytest.mark.slow
def test_files_are_read_by_import_and_analyse(thermap, tmp_path):
    folder = tmp_path / "lagging"
    effect = ("--effect", "backlash:constant", "--size", 2, "--machine", "practice")
    found = thermap("simulate", "campaign", *SMALL, *effect, "-o", folder)
    assert (found.exit_code, found.stderr) == (0, "")
    assert "machine 'practice'" in found.stdout
    made = make_campaign(5, "backlash:constant", 2.0, 8, observations_per_visit=24, later_visits=2)
    truth = stored(folder / "truth.json")
    assert truth["effects"] == list(made.truth.effects)
    assert len(truth["later"]["asked"]) == len(truth["later"]["true_um"]) == 48
    others = [file for file in folder.iterdir() if file.name != "truth.json"]
    assert all("contribution" not in file.read_text(encoding="utf-8") for file in others)
    files = sorted(folder.glob("verification-*.json"))
    assert all(VerificationRequest.model_validate(stored(file)).to_verification() for file in files)
    assert [stored(file) for file in files] == made.verifications
    sent = [
        folder / "machine.json",
        *sorted(folder.glob("error-map-*")),
        folder / "readings-001.json",
    ]
    imported = thermap("import", *sent, "--machine", "practice")
    assert imported.exit_code == 0, imported.output
    assert f"{len(stored(folder / 'readings-001.json'))} readings stored" in imported.stdout


@pytest.mark.slow
def test_straight_into_the_service(thermap, client):
    found = thermap("simulate", "campaign", *SMALL, "--store", "--machine", "practice")
    assert found.exit_code == 0, found.output
    try:
        assert len(client.verifications("practice")) == 8
        assert len(client.error_maps("practice")) == 3
    finally:
        client.delete_machine("practice")


@pytest.mark.slow
def test_a_record_whole_and_in_parts(thermap, tmp_path):
    asked = ("--record", 4, "--wander", 1.5, "--resolution", 0.5, "--later", 2, "--seed", 5)
    for name, split in (("whole", ()), ("parts", ("--split", 60))):
        found = thermap("simulate", "campaign", *asked, *split, "-o", tmp_path / name)
        assert found.exit_code == 0, found.output
    made = make_record(
        5, [], 3.0, 4.0, 20.0, 24, wander_um=1.5, measured_quantum_um=0.5, later_visits=2
    )
    whole = stored(tmp_path / "whole" / "verification-001.json")
    assert whole == made.as_one_verification()
    parts = [stored(file) for file in sorted((tmp_path / "parts").glob("verification-*"))]
    assert len(parts) == 4
    assert [o for part in parts for o in part["observations"]] == whole["observations"]


def test_unknown_is_an_effect_that_no_kind_describes(thermap, tmp_path):
    found = thermap("simulate", "campaign", *SMALL, "--effect", "unknown", "-o", tmp_path / "u")
    assert found.exit_code == 0, found.output
    (effect,) = stored(tmp_path / "u" / "truth.json")["effects"]
    assert effect["kind"] in UNKNOWN
    assert not effect["in_library"]


def test_unknown_is_none_of_those_stated_by_name(thermap, tmp_path):
    drawn = list(UNKNOWN)[1:3]
    named = [option for kind in drawn for option in ("--effect", kind)]
    asked = (*SMALL, "--seed", 1, *named, "--effect", "unknown")
    found = thermap("simulate", "campaign", *asked, "-o", tmp_path / "u")
    assert found.exit_code == 0, found.output
    kinds = [effect["kind"] for effect in stored(tmp_path / "u" / "truth.json")["effects"]]
    assert len(set(kinds)) == 3
    assert set(kinds) <= set(UNKNOWN)


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        (("--effect", "magnetism"), "expected an effect of thermal-lag"),
        (("--record", 1), "at least 4 blocks"),
        ((), "got neither"),
    ],
)
def test_what_cannot_be_made_is_a_sentence(thermap, tmp_path, asked, sentence):
    where = ("-o", tmp_path / "new") if asked else ()
    found = thermap("simulate", "campaign", *asked, *where)
    assert found.exit_code == 2
    assert sentence in " ".join(found.stderr.replace("│", " ").split())


def test_a_folder_that_holds_something_is_left_alone(thermap, tmp_path):
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    found = thermap("simulate", "campaign", *SMALL, "-o", tmp_path)
    assert found.exit_code == 2
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--effect", "none", "--effect", "backlash"), "expected none alone, got backlash beside"),
        (("--effect", "none", "--effect", "none"), "expected none alone, got it twice"),
        (("--effect", "clock-offset:an-hour-late", "--effect", "clock-offset"), "it twice"),
        (("--effect", "unknown", "--effect", "unknown"), "expected unknown once"),
        (
            [o for kind in (*UNKNOWN, "unknown") for o in ("--effect", kind)],
            "leave one to be drawn, got all of them",
        ),
        (("--record", "nan"), "got 'nan'"),
        (("--record", 30, "--every", "inf"), "--every: expected a finite number, got inf"),
        (("--size", "inf"), "--size: expected a finite number, got inf"),
        (("--size", "x"), "expected a number, got 'x'"),
    ],
)
def test_what_cannot_be_planted_is_refused_with_what_came(run, tmp_path, options, said):
    folder = tmp_path / "c"
    found = run("simulate", "campaign", *options, "-o", folder, columns=200)
    assert found.exit_code == 2
    assert said in " ".join(found.stderr.split())
    assert not folder.exists()


def test_the_same_effect_again_is_one_more_on_another_component(run, tmp_path):
    twice = ("--effect", "backlash", "--effect", "backlash")
    found = run("simulate", "campaign", *SMALL, *twice, "-o", tmp_path / "c")
    assert found.exit_code == 0, found.output
    planted = stored(tmp_path / "c" / "truth.json")["effects"]
    assert [one["kind"] for one in planted] == ["backlash", "backlash"]
    first, second = (set(one["components"]) for one in planted)
    assert not first & second
