"""The house: who may import whom, what is pure, and what docstrings promise."""

import ast
import graphlib
import importlib
import importlib.util
import inspect
import pkgutil
import re
import sys
from functools import cache
from pathlib import Path

import app
import thermap

PACKAGE = Path(app.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

FLOORS = [
    {"languages"},
    {"units", "errors", "arrays", "answer", "rounding", "csv_text", "decimal_text", "foreign_text"},
    {"in_pieces", "stated"},
    {"geometry", "supervision", "field_errors", "json_text"},
    {"thermal"},
    {"compensation", "measurement", "pictures", "simulation"},
    {"access", "events", "search", "status"},
    {"effects"},
    {"identification"},
    {"storage", "live", "controllers", "programs", "files", "hal", "settings"},
    {"services"},
    {"pages", "connections"},
    {"api"},
    {"cli"},
    {"main", "__main__"},
]
"""A room imports from floors below its own; from its own floor only itself."""

MAY_ALSO = {("cli", "main")}
"""The command line starts the service."""

CLIENT = Path(thermap.__file__).parent
CLIENT_LIBRARIES = {"httpx", "pydantic", "thermap"} | set(sys.stdlib_module_names)
"""What users import stands on two libraries; numpy only where an answer is made an array."""

MAY_USE_THE_CLIENT = {"cli", "__init__"}
"""The command line speaks to the service as users do; the version stands in `thermap`."""

PURE = {
    *(
        "units",
        "errors",
        "arrays",
        "answer",
        "rounding",
        "in_pieces",
        "stated",
        "csv_text",
        "decimal_text",
        "foreign_text",
        "languages",
        "geometry",
        "thermal",
    ),
    *(
        "compensation",
        "controllers",
        "programs",
        "measurement",
        "pictures",
        "simulation",
        "search",
        "effects",
        "identification",
        "status",
        "pages",
    ),
}
"""No clock, no database, no HTTP: time and temperatures come in as arguments."""

# pydantic reads the fields of what is asked and answered, and their descriptions, where it is
# defined.
PURE_LIBRARIES = {
    *(
        "numpy",
        "scipy",
        "threadpoolctl",
        "plotly",
        "pydantic",
        "pydantic_core",
        "jinja2",
        "markupsafe",
        "babel",
        "app",
    )
} | (
    set(sys.stdlib_module_names)
    - {"time", "os", "pathlib", "random", "sqlite3", "socket", "threading", "asyncio", "http"}
)


def room_of(path):
    relative = path.relative_to(PACKAGE)
    return relative.parts[0].removesuffix(".py")


def floor_of(room):
    return next(i for i, rooms in enumerate(FLOORS) if room in rooms)


@cache
def text_of(path):
    return path.read_text(encoding="utf-8")


def nodes_of(path):
    return ast.walk(ast.parse(text_of(path)))


IMPORT = re.compile(r"^ *(?:from (\S+) import\b|import (\w[\w.]*)(?: as \w+)?(?:  #.*)?$)", re.M)
"""Ruff lets nobody import two modules in one line, or in a line with something else."""


@cache
def imports_of(path):
    """Name every module that a file imports, whole paths."""
    modules = {one or other for one, other in IMPORT.findall(text_of(path))}
    assert not any(name.startswith(".") for name in modules), f"{path} imports relatively"
    return modules


def test_every_room_has_a_floor():
    for path in MODULES:
        if room_of(path) != "__init__":
            floor_of(room_of(path))


def test_imports_go_down_only():
    wrong = [
        f"{path.relative_to(PACKAGE)} may not import {module}"
        for path in MODULES
        for module in sorted(imports_of(path))
        if module.startswith("app.") and not may_import(room_of(path), module.split(".")[1])
    ]
    assert wrong == []


def may_import(room, other):
    if room == "__init__":
        return False
    return other == room or floor_of(other) < floor_of(room) or (room, other) in MAY_ALSO


def test_no_modules_import_each_other_in_a_circle():
    """Nor where they are imported inside functions, or for their types alone."""
    paths = {".".join(p.relative_to(PACKAGE.parent).with_suffix("").parts): p for p in MODULES}
    modules = {name.removesuffix(".__init__"): path for name, path in paths.items()}
    imports = {name: imports_of(path) & modules.keys() - {name} for name, path in modules.items()}
    assert len(imports) > 600
    graphlib.TopologicalSorter(imports).prepare()


OF_EXTRAS = {
    "calls.py": {"numpy"},
    "table.py": {"numpy", "pandas", "xarray", "matplotlib"},
}
"""What the client imports where it is needed, of its extras."""


def test_the_client_knows_nothing_of_the_application():
    for path in sorted(CLIENT.rglob("*.py")):
        roots = {module.split(".")[0] for module in imports_of(path)}
        allowed = CLIENT_LIBRARIES | OF_EXTRAS.get(path.name, set())
        assert roots <= allowed, f"{path} imports {roots - allowed}"


def test_the_command_line_alone_uses_the_client():
    for path in MODULES:
        if room_of(path) not in MAY_USE_THE_CLIENT:
            ours = {m for m in imports_of(path) if m.split(".")[0] == "thermap"}
            assert ours == set(), f"{path} imports {ours}"


def test_the_command_line_sends_files_as_they_are():
    """It reads one kind itself, the recording that it plays, and writes what it simulates."""
    for path in (PACKAGE / "cli").rglob("*.py"):
        of_files = {m for m in imports_of(path) if m.startswith("app.files")}
        assert of_files <= {"app.files.recording", "app.files.csv_writing"}, path


def test_the_search_knows_only_its_rows():
    own = ("app.search", "app.arrays", "app.errors")
    for path in (PACKAGE / "search").rglob("*.py"):
        for module in imports_of(path):
            assert not module.startswith("app") or module.startswith(own), (
                f"{path} imports {module}"
            )


def test_what_judges_the_search_shares_nothing_with_it():
    """The simulated effects are written again from their definitions, on numpy and scipy alone."""
    own = "app.simulation.undeclared"
    allowed = {"numpy", "scipy"} | set(sys.stdlib_module_names)
    room = PACKAGE / "simulation" / "undeclared"
    assert len(list(room.rglob("*.py"))) > 20
    for path in room.rglob("*.py"):
        foreign = {m for m in imports_of(path) if m != own and not m.startswith(f"{own}.")}
        roots = {module.split(".")[0] for module in foreign}
        assert roots <= allowed, f"{path} imports {sorted(foreign)}"


def test_what_runs_in_linuxcncs_python_needs_nothing_of_ours():
    """The oldest one is 3.9, and no library of ours is there."""
    room = PACKAGE / "hal"
    assert len(list(room.rglob("*.py"))) > 3
    for path in room.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        ast.parse(text, feature_version=(3, 9))
        for module in imports_of(path):
            ours = module.startswith("app.hal.")
            assert ours or module.split(".")[0] in sys.stdlib_module_names, f"{path}: {module}"


def test_benchmarks_stand_outside():
    """What is installed, and what tests it, needs nothing of what is only run from a checkout."""
    pattern = re.compile(r"^\s*(?:from|import) benchmarks\b", re.M)
    paths = [*MODULES, *CLIENT.rglob("*.py"), *Path(__file__).parent.rglob("*.py")]
    assert [str(p) for p in paths if pattern.search(p.read_text(encoding="utf-8"))] == []


def test_benchmarks_and_examples_import_what_there_is():
    """Most of them run for minutes, so no other test would miss a name that was changed."""
    root = PACKAGE.parent
    missing = [
        f"{path.relative_to(root)}: {node.module}.{name.name}"
        for folder in ("benchmarks", "examples")
        for path in sorted((root / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(("app.", "thermap"))
        for name in node.names
        if not exists(node.module, name.name)
    ]
    assert missing == []


def exists(module, name):
    """Whether a module has a name, or a module of that name in it."""
    return hasattr(importlib.import_module(module), name) or bool(
        importlib.util.find_spec(f"{module}.{name}")
    )


def test_pure_rooms_know_no_clock_and_no_world():
    clock = re.compile(r"\.(now|utcnow|today)\b")
    for path in (p for p in MODULES if room_of(p) in PURE):
        roots = {module.split(".")[0] for module in imports_of(path)}
        assert roots <= PURE_LIBRARIES, f"{path} imports {roots - PURE_LIBRARIES}"
        for node in nodes_of(path) if clock.search(text_of(path)) else ():
            assert not (
                isinstance(node, ast.Attribute) and node.attr in {"now", "utcnow", "today"}
            ), f"{path} reads the clock"


def test_storage_alone_speaks_sql():
    for path in MODULES:
        if room_of(path) not in {"storage"}:
            sql = {
                m for m in imports_of(path) if m.startswith(("sqlalchemy", "psycopg", "sqlite3"))
            }
            assert sql <= {"sqlalchemy.exc", "sqlalchemy.orm"}, f"{path} imports {sql}"


def test_migrations_import_only_the_tables_metadata():
    folder = PACKAGE.parent / "migrations"
    for path in folder.rglob("*.py"):
        ours = {m for m in imports_of(path) if m.startswith("app")}
        assert ours <= ({"app.storage.tables"} if path.name == "env.py" else set())


def public_functions():
    for info in pkgutil.walk_packages(app.__path__, "app."):
        if info.name.split(".")[1] not in PURE:
            continue
        module = importlib.import_module(info.name)
        for name, thing in vars(module).items():
            if name.startswith("_") or getattr(thing, "__module__", None) != info.name:
                continue
            if inspect.isfunction(thing):
                yield f"{info.name}.{name}", thing
            if inspect.isclass(thing):
                for method, function in vars(thing).items():
                    if inspect.isfunction(function) and not method.startswith("_"):
                        yield f"{info.name}.{name}.{method}", function


def test_docstrings_of_pure_functions():
    wrong = [f"{name} {what}" for name, f in public_functions() for what in missing_in(f)]
    assert wrong == []


SECTION = r"^{}\n-+\n(.*?)(?=^\w+\n-+\n|\Z)"
PARAMETERS = re.compile(SECTION.format("Parameters"), re.M | re.S)
RETURNS = re.compile(SECTION.format("Returns"), re.M | re.S)
ENTRY = re.compile(r"^(\S[^\n]*)((?:\n[ \t]+\S[^\n]*|\n(?=\n[ \t]))*)", re.M)
NAMES = re.compile(r"\*{0,2}([A-Za-z_0-9]+(?:, \*{0,2}[A-Za-z_0-9]+)*)(?: : (.*))?")


def entries_of(text):
    """Give names, type and words of each entry of the section Parameters."""
    section = PARAMETERS.search(text)
    for heading, words in ENTRY.findall(section[1]) if section else ():
        names, kind = NAMES.fullmatch(heading).groups()
        yield set(re.findall(r"\w+", names)), kind or "", " ".join(words.split())


def missing_in(function):
    """Say what a docstring lacks."""
    text = inspect.getdoc(function)
    if not text:
        yield "has no docstring"
        return
    if not text.split("\n\n")[0].strip().endswith((".", "?")):
        yield "begins with a paragraph that is no sentence"
    taken = set(inspect.signature(function).parameters) - {"self", "cls"}
    for names, kind, _ in entries_of(text):
        if names - taken:
            yield f"describes {names - taken}, which it does not take"
        if "ndarray" in kind and "shape" not in kind:
            yield f"gives {names} no shape"


def documented():
    """Give each function and class with a docstring, and the annotations of its parameters."""
    has_parameters = re.compile(r"^ *Parameters$", re.M)
    for path in [*MODULES, *sorted(CLIENT.rglob("*.py"))]:
        for node in nodes_of(path) if has_parameters.search(text_of(path)) else ():
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
                types = {a.arg: ast.unparse(a.annotation) for a in arguments if a.annotation}
            elif isinstance(node, ast.ClassDef):
                fields = [field for field in node.body if isinstance(field, ast.AnnAssign)]
                types = {ast.unparse(f.target): ast.unparse(f.annotation) for f in fields}
            else:
                continue
            if text := ast.get_docstring(node):
                yield f"{path.name}: {node.name}", node.name, types, text


def words_in(text):
    """Split names and prose into words, without case, plurals and what says nothing."""
    parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+|[^\W\d_]+|\d+", text)
    return {part.lower().removesuffix("s") for part in parts} - SAYS_NOTHING


SAYS_NOTHING = {
    *("the", "a", "an", "of", "it", "thi", "that", "which", "is", "are", "all", "to", "be", "in"),
    *("what", "whose", "their", "and", "for", "given", "each", "used", "value", "object"),
}


def repeats_its_name(names, kind, words, types, owner):
    """Whether an entry has no word that name, type and owner do not have.

    With a shape or a unit of its own, an entry needs no words.
    """
    if "None" in words or (kind and not words):
        return False
    text = " ".join([owner, *names, *(types.get(name, "") for name in names)])
    units = {name.rsplit("_", 1)[-1] for name in names}
    return not words_in(words) - words_in(text) - words_in(" ".join(units))


def test_no_entry_of_a_docstring_repeats_a_name_or_a_type():
    """A section is for units, shapes, signs and the meaning of None that the type does not say."""
    described = 0
    wrong = []
    for place, owner, types, text in documented():
        for names, kind, words in entries_of(text):
            described += 1
            if repeats_its_name(names, kind, words, types, owner):
                wrong.append(f"{place} describes {names}: {words}")
    assert described > 1000
    assert wrong == []


def test_no_returns_repeats_its_annotation():
    """What the annotation says needs no section; a shape, a unit or a range does."""
    sections = [(place, RETURNS.search(text)) for place, _, _, text in documented()]
    returned = [(place, section[1].strip()) for place, section in sections if section]
    assert len(returned) > 300
    bare = re.compile(r"[\w.]+(?: (?:of|or) [\w.]+)*")
    assert [f"{place}: {words}" for place, words in returned if bare.fullmatch(words)] == []


def test_what_an_entry_must_not_be():
    types = {"campaign": "Campaign", "table": "CompensationTable", "wait_s": "float"}
    assert repeats_its_name({"campaign"}, "", "The campaign.", types, "analyse")
    assert repeats_its_name({"table"}, "", "The compensation table.", types, "compare")
    assert repeats_its_name({"wait_s"}, "", "Wait [s].", types, "Turns")
    assert repeats_its_name({"nodes_mm"}, "ndarray, shape (n,) [mm]", "The nodes.", {}, "locate")
    assert not repeats_its_name({"nodes_mm"}, "ndarray, shape (n,) [mm]", "", {}, "locate")
    assert not repeats_its_name({"wait_s"}, "", "None: for ever.", types, "Turns")
    assert not repeats_its_name({"wait_s"}, "", "Longest [s].", types, "Turns")


def test_factors_of_thousand_stand_in_units_alone():
    for path in MODULES:
        if room_of(path) in PURE - {"units"}:
            for node in nodes_of(path):
                assert not (
                    isinstance(node, ast.BinOp)
                    and isinstance(node.right, ast.Constant)
                    and node.right.value in (1000, 1000.0, 1e-3, 1e6, 1e-6)
                ), f"{path}:{node.lineno} converts a unit by hand"
