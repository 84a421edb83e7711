"""The template of a study, made from the fields in `pipeline.config.schema`.

Of each its name, default or example, and description.
"""

import json
import textwrap
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hbm.spelling import packaged_toml, printable
from pipeline.config.found_recordings import FoundSubject
from pipeline.config.schema import StudyFile, SubjectFile
from pipeline.config.toml_file import models_in
from pipeline.io.write import whole_file

WIDTH: Final = 30
"""Columns of a key and its value, before the description."""
in_toml = partial(json.dumps, ensure_ascii=False)
TEMPLATE: Final = packaged_toml("pipeline.config", "template.toml")


def write_template(
    folder: Path,
    subjects: Sequence[FoundSubject] = (),
    treadmill: Mapping[str, Any] | None = None,
    *,
    every: bool = False,
) -> tuple[Path, ...]:
    """Write ``study.toml`` and the subjects' files; give all.

    The study is of the subjects found, the conditions of their trials and what is known of the
    treadmill; without any, it is an example. With `every`, all keys are there with their
    descriptions, behind a # where nothing is stated.

    Raises
    ------
    ValueError
        If there already is a study; nothing is overwritten.
    OSError
        If the folder cannot be written to; no file is there then.
    """
    conditions = {
        condition: dict[str, Any]() for subject in subjects for condition in subject.trials
    }
    laboratory = {"name": printable(folder.resolve().name), "treadmill": treadmill or {}}
    study, subject = TEMPLATE["study"], TEMPLATE["subject"]
    values = study["given"] | ({**laboratory, "conditions": conditions} if subjects else {})
    texts = {folder / "study.toml": template(StudyFile, study["heading"], values, every=every)}
    for person in [_given(subject) for subject in subjects] or [subject["given"]]:
        file = folder / f"{person['id']}.toml"
        texts[file] = template(SubjectFile, subject["heading"], person, every=every)
    for path in texts:
        if path.exists():
            raise ValueError(f"{path} is already there; nothing was written")
    with ExitStack() as stack:
        for path, text in texts.items():
            stack.enter_context(whole_file(path)).write_text(text, encoding="utf-8")
    return tuple(texts)


def _given(subject: FoundSubject) -> dict[str, Any]:
    """Give what the file of a subject found states."""
    trials = dict[str, Any]()
    for name, tables in subject.trials.items():
        files = {"files": [table["file"] for table in tables]}
        several = tables if any(len(table) > 1 for table in tables) else files
        trials[name] = several if tables[1:] else tables[0]
    poses = {"static": subject.static, "hip_trial": subject.hip_trial}
    keys = {key: file for key, file in poses.items() if file}
    return {"id": subject.name, "sex": "unspecified", **keys, "trials": trials}


def template(
    kind: type[BaseModel], headings: Mapping[str, str], values: Mapping[str, Any], *, every: bool
) -> str:
    """Give a TOML file of a model: what is given or, with `every`, all keys, others behind a #."""
    lines = _lines(kind, "", values, every)
    return "\n".join([headings["every" if every else "used"], *lines]) + "\n"


def _lines(
    kind: type[BaseModel], table: str, values: Mapping[str, Any] | None, every: bool
) -> list[str]:
    """Lay out a model's keys, then its tables; all behind a # where nothing is given."""
    others = {k: v for k, v in (values or {}).items() if k not in kind.model_fields}
    keys, tables = [f"{k} = {in_toml(v)}" for k, v in others.items()], list[str]()
    # what a person should state of each subject, though it may be missing
    asked = ("sex", "mass_kg", "height_m")
    for name, field in kind.model_fields.items():
        given = None if values is None else values.get(name)
        if field.exclude or not (every or given or name in asked):
            continue
        place = f"{table}.{name}" if table else name
        if inner := models_in(field.annotation):
            tables += _tables(inner[0], place, field, given, every)
        elif isinstance(example := _example(field), dict):
            if all(isinstance(inner, dict) for inner in example.values()):
                ((inner_name, example),) = example.items()
                place = f"{place}.{inner_name}"
            sign, example = ("", given) if given else ("# ", example)
            comment = _comment(f"{sign}[{place}]", field.description)
            tables += ["", *comment, *(f"{sign}{k} = {in_toml(v)}" for k, v in example.items())]
        else:
            value = _example(field) if given is None else given
            # another setting decides whether a hip trial has an effect
            sign = "# " if given is None or name == "hip_trial" else ""
            if value is not None:
                keys += _comment(f"{sign}{name} = {in_toml(value)}", field.description)
    return keys + tables


def _tables(
    kind: type[BaseModel], place: str, field: FieldInfo, values: Any, every: bool
) -> list[str]:
    """Lay out the table of a model, of each name of a mapping, or of a list's item."""
    kind_of_table = str(field.annotation)
    if kind_of_table.startswith("dict"):
        lines = list[str]()
        for name, table in values.items():
            header = f"[[{place}.{name}]]" if isinstance(table, list) else f"[{place}.{name}]"
            for one in table if isinstance(table, list) else [table]:
                keys = [f"{key} = {in_toml(value)}" for key, value in (one or {}).items()]
                if every and not lines:  # the keys that are not stated are shown once
                    keys = _lines(kind, f"{place}.{name}", one, every)
                lines += [*([""] if keys or every or not lines else []), header, *keys]
        return lines
    header = f"[[{place}]]" if "tuple" in kind_of_table else f"[{place}]"
    about = (kind.__doc__ or "").partition("\n\n    Examples")[0].replace("\n    ", "\n")
    lines = [f"# {line}".rstrip() for line in about.strip().splitlines() if every]
    sign = "# " if values is None else ""
    return ["", *lines, f"{sign}{header}", *_lines(kind, place, values, every)]


def _example(field: FieldInfo) -> Any:
    """Give the default of a field or, where there is none, an example."""
    return field.examples[0] if field.examples else field.get_default(call_default_factory=False)


def _comment(text: str, description: str | None) -> list[str]:
    """Put a description behind a text, or above a long one."""
    if len(text) > WIDTH:
        return [*textwrap.wrap(f"# {description}", 100, subsequent_indent="# "), text]
    first, *others = textwrap.wrap(description or "", 97 - WIDTH)
    return [f"{text:<{WIDTH}} # {first}", *(f"{'#':<{WIDTH}} # {line}" for line in others)]
