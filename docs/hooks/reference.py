"""The pages of the site that are generated from the code: keys, columns, commands, Python."""

import ast
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import typer.main
from pydantic import BaseModel

import harness
from harness.cli.app import application
from harness.results import catalogue as results_catalogue, tables as results
from harness.scenario import Scenario, pedestrians, sections, traffic

UNITS = {
    "_per_hour": "1/h",
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_deg": "°",
    "_m": "m",
    "_s": "s",
    "_h": "h",
}
"""Units by the ending of a name; longer endings come first."""

KEY_MODULES = (sections, pedestrians, traffic)
"""The modules with the keys of a scenario."""

CONSTANT = re.compile("``([A-Z_]+)``")
"""A constant in a docstring."""

TYPES = {"number": "number", "integer": "whole number", "boolean": "`true` or `false`"}
BOUNDS = {
    "minimum": "≥ {}",
    "exclusiveMinimum": "> {}",
    "maximum": "≤ {}",
    "exclusiveMaximum": "< {}",
}
COLUMN_TYPES = {
    pa.string(): "text",
    pa.bool_(): "true or false",
    pa.int32(): "whole number",
    pa.int64(): "whole number",
    pa.float64(): "number",
}


def unit_of(name: str) -> str:
    """The unit in the ending of a key or column; empty if the ending has none."""
    base = name.removesuffix("_ci_low").removesuffix("_ci_high").removesuffix("_human")
    return next((unit for ending, unit in UNITS.items() if base.endswith(ending)), "")


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a table in Markdown."""
    names = [*head]
    lines = [names, ["---"] * len(names), *rows]
    return ["| " + " | ".join(in_cell(text) for text in line) + " |" for line in lines]


def in_cell(text: str) -> str:
    """Text for a cell of a Markdown table; only code in backticks keeps its markup."""
    parts = text.replace("|", "\\|").split("`")
    return "`".join(part if at % 2 else part.replace("<", "&lt;") for at, part in enumerate(parts))


def keys_page() -> str:
    """Every key of a scenario: type and range, unit, default, meaning."""
    lines = [
        "# Keys of a scenario",
        "",
        "Every key has a default, so a scenario file has only the keys that differ. Unknown keys",
        "and keys without effect are refused. A key that ends in `_mps` also takes text with a",
        'unit, in files, `--set` and `--vary`: `"50 km/h"`, `"30 mph"`, `"12 ft/s"`, `"8 m/s"`.',
        "[Files](../files.md#scenario-toml) says how files and `--set` are read. The keys of",
        "`[strategies]` are the parameters of [strategies](../strategies.md).",
    ]
    documented = meanings_of_keys()
    for path, section in sections_of(Scenario):
        lines += ["", f"## {path}", "", summary_of(section), ""]
        lines += table(
            ("key", "values", "unit", "default", "meaning"),
            (
                [f"`{name}`", values_of(schema), unit_of(name), default_of(section, name), meaning]
                for name, schema in properties(section).items()
                if not is_section(schema)
                for meaning in [documented[section.__name__, name] + conditions_of(section, name)]
            ),
        )
    return "\n".join(lines) + "\n"


def sections_of(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Every section of a scenario with the heading of its table in a file."""
    for name, schema in properties(model).items():
        section = section_in(schema)
        if section is None:
            continue
        heading = f"{path}.{name}" if path else name
        many = "items" in schema
        yield (f"[[{heading}]]" if many else f"[{heading}]"), section
        yield from sections_of(section, heading)


def properties(model: type[BaseModel]) -> dict[str, dict[str, Any]]:
    """The JSON schemas of a section's keys; an optional key has the schema without null."""
    schemas = {}
    for name, schema in model.model_json_schema()["properties"].items():
        choices = [choice for choice in schema.get("anyOf", []) if choice != {"type": "null"}]
        schemas[name] = choices[0] if len(choices) == 1 else schema
    return schemas


def section_in(schema: Mapping[str, Any]) -> type[BaseModel] | None:
    """The section that a key holds, alone or as a list."""
    name = schema.get("items", schema).get("$ref", "").rpartition("/")[2]
    modules = (module for module in KEY_MODULES if hasattr(module, name))
    return getattr(next(modules), name) if name else None


def is_section(schema: Mapping[str, Any]) -> bool:
    """Whether a key is a table with a heading of its own."""
    return section_in(schema) is not None


def values_of(schema: Mapping[str, Any]) -> str:
    """The values that a key takes, in words."""
    if "anyOf" in schema:
        return ", or ".join(values_of(choice) for choice in schema["anyOf"])
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if "items" in schema:
        return f"a list: {values_of(schema['items'])}"
    if "additionalProperties" in schema:
        return f"a table: {values_of(schema['additionalProperties'])}"
    bounds = [form.format(number(schema[key])) for key, form in BOUNDS.items() if key in schema]
    kind = TYPES.get(schema.get("type", ""), "text")
    return " ".join([kind, ", ".join(bounds)]) if bounds else kind


def number(bound: float) -> str:
    """The text of a bound."""
    return "2⁶³" if bound == 2**63 else f"{bound:,}".removesuffix(".0")


def default_of(section: type[BaseModel], name: str) -> str:
    """A key's default as a file would write it."""
    field = section.model_fields[name]
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True, validated_data={})
    if value in (None, (), "", {}):
        return "none"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def conditions_of(section: type[BaseModel], name: str) -> str:
    """When a key has an effect, in sentences; empty if always."""
    marks = section.model_fields[name].metadata
    return "".join(f" Only {each.words}." for each in marks if isinstance(each, sections.Only))


def meanings_of_keys() -> dict[tuple[str, str], str]:
    """The docstring below each key, by the name of its section's class and its own name."""
    meanings = {}
    for node in ast.parse("".join(map(inspect.getsource, KEY_MODULES))).body:
        if not isinstance(node, ast.ClassDef):
            continue
        for key, text in zip(node.body, node.body[1:], strict=False):
            if isinstance(key, ast.AnnAssign) and isinstance(text, ast.Expr):
                name, value = ast.unparse(key.target), ast.literal_eval(text.value)
                meanings[node.name, name] = in_markdown(value)
    return meanings


def summary_of(section: type[BaseModel]) -> str:
    """A section's docstring without its heading."""
    text = in_markdown(inspect.getdoc(section) or "")
    summary = text.split("`: ", 1)[-1]
    return summary[:1].upper() + summary[1:]


def in_markdown(text: str) -> str:
    """A docstring's text on one line, with code marked as in Markdown and constants by value."""
    text = CONSTANT.sub(lambda constant: quantity(constant[1]), " ".join(text.split()))
    return text.replace("``", "`")


def quantity(name: str) -> str:
    """The value of a constant of the modules with the keys, with its unit."""
    value = next(getattr(module, name) for module in KEY_MODULES if hasattr(module, name))
    return f"{value:g} {unit_of(name.lower())}"


def meanings_of(entry: results_catalogue.Entry) -> Iterator[str]:
    """The meanings of the numbers of an entry: the AV's, the reference's, and their difference."""
    yield entry.meaning
    yield f"`{entry.key}` of the reference's arm."
    yield f"`{entry.key}`, the AV's minus the reference's, pair by pair."


def columns_page() -> str:
    """Every column of every table of a run."""
    lines = [
        "# Columns",
        "",
        "These are the columns of a run folder's tables. [Files](../files.md#run-folder) describes",
        "the files. A missing value is null in Parquet and empty in CSV.",
        "",
        "A number with an interval has its two ends in the columns `_ci_low` and `_ci_high`. The",
        "interval is two-sided, with the `confidence` of the row. A share has its counts in",
        "`_events` and `_n`. [Method](../method.md) and [Measures](../measures.md) have the",
        "definitions.",
    ]
    for kind, of_kind in results.TABLES_OF.items():
        for parts in of_kind:
            lines += ["", f"## {parts.name}/ of {kind}", ""]
            lines += table(
                ("column", "type", "unit", "meaning"),
                ([f"`{of.name}`", kind_of(of.type), of.unit, of.meaning] for of in parts.columns),
            )
        lines += ["", f"## summary.csv and findings.json of {kind}", ""]
        lines += table(
            ("number", "reliable from", "unit", "meaning"),
            (
                [f"`{key}`", f"{least:,} pairs" * (least > 0), of.unit, text]
                for of in results_catalogue.entries_of(kind)
                for least in (of.estimate.reliable_from,)
                for key, text in zip(of.keys, meanings_of(of), strict=False)
            ),
        )
    return "\n".join(lines) + "\n"


def kind_of(kind: pa.DataType) -> str:
    """A column's type in words."""
    if pa.types.is_list(kind):
        return "list of legs" if "y_mps2" in str(kind) else "list of rows"
    return COLUMN_TYPES[kind]


def commands_page() -> str:
    """Every command with its arguments and options, from the texts of ``--help``."""
    lines = [
        "# Commands",
        "",
        "`harness COMMAND --help` prints the same on the terminal.",
        "",
        "| exit code | meaning |",
        "|---|---|",
        "| 0 | success |",
        "| 1 | something failed during the run |",
        "| 2 | the input was refused |",
        "| 130, 143 | the command was interrupted (Ctrl-C, SIGTERM) |",
    ]
    for name, command in commands(typer.main.get_command(application())):
        lines += ["", f"## harness {name}", "", in_markdown(command.help or ""), ""]
        rows = [
            [usage_of(option), (option.help or "").strip(), shown_default(option)]
            for option in command.params
            if "--help" not in option.opts
        ]
        lines += table(("argument or option", "meaning", "default"), rows)
    return "\n".join(lines) + "\n"


def commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Every command with its full name; commands of groups are included."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command


def usage_of(option: Any) -> str:
    """An argument or option as it is written in the shell."""
    if option.param_type_name == "argument":
        word = option.metavar or option.name.upper()
        return f"`{word}`" if option.required else f"`[{word}]`"
    value = "" if option.is_flag else f" {(option.metavar or option.name).strip('_').upper()}"
    return ", ".join(f"`{text}{value}`" for text in option.opts)


def shown_default(option: Any) -> str:
    """An option's default; empty if there is none or if it says nothing."""
    if option.required:
        return "required"
    silent = option.default is None or option.default is False or option.default == ()
    return "" if silent else f"`{option.default}`"


def python_page() -> str:
    """Every public name with its docstring, by mkdocstrings."""
    stub = Path(harness.__file__).with_suffix(".pyi")
    lines = [
        "# Python",
        "",
        "These are the public names of `import harness`, with shapes, units and ranges, and with",
        "the conditions under which a value is undefined. [In Python](../python.md) shows how to",
        "use them together.",
    ]
    modules = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        assert isinstance(node, ast.ImportFrom)
        for alias in node.names:
            modules[alias.name] = f"harness.{node.module}.{alias.name}"
    for name, module in sorted(modules.items(), key=lambda item: item[0].lower()):
        heading = f"harness.{name}"
        lines += ["", f"::: {module}", "    options:", f"      heading: {heading}"]
        lines += [f"      toc_label: {heading}"]
    return "\n".join(lines) + "\n"


PAGES: dict[str, Callable[[], str]] = {
    "reference/keys.md": keys_page,
    "reference/columns.md": columns_page,
    "reference/commands.md": commands_page,
    "reference/names.md": python_page,
}
"""Generated pages by their path in the site."""
