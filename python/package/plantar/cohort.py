"""Evaluates a whole study with Dask, and writes the same table as ``plantar cohort``.

``python -m plantar.cohort STUDY --out TABLE`` evaluates the participants in parallel: in threads or processes of this computer,
or on the workers of a Dask scheduler. ``STUDY`` and ``TABLE`` are folders or addresses that fsspec supports, such as
``s3://bucket/study``.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import os
import pathlib
import posixpath
import sys
import time
import uuid
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import dask
import distributed
import fsspec
import pyarrow
import pyarrow.parquet
from dask.system import CPU_COUNT
from fsspec.implementations.local import LocalFileSystem

from plantar import _core
from plantar.fitting import defects_of
from plantar.options import Options
from plantar.paths import expanded
from plantar.recording import REGIONS

_MADE_FROM = b"plantar.made_from"
"""The metadata key in a file of the table for a description of the inputs from which the file was made. The file is up to date
if the description is that of the present inputs."""
_STAMPS = ("size", "mtime", "created", "LastModified", "ETag", "etag", "md5Hash")
"""Properties that file systems report for a file. At least one of them differs after a change of the file."""
_CONNECT_TIMEOUT = "5s"


@dataclass(frozen=True)
class Outcome:
    """The result of one participant."""

    participant: str
    steps: int
    """The number of steps in the table."""
    is_cached: bool
    """True if the rows in the table were already up to date."""
    left_out: tuple[str, ...] = ()
    """The reasons why recordings or the participant could not be used, also files in sub-folders of the participant."""
    incomplete: tuple[str, ...] = ()
    """The defects of the fits, with the names of participant, recording and region."""
    notes: tuple[str, ...] = ()
    """A note on each value of the tissue measurements that is out of range and therefore not used."""


def _is_folder(files: Any, entry: dict[str, Any]) -> bool:
    return bool(entry["type"] == "directory" or (entry.get("islink") and files.isdir(entry["name"])))


def _parquet_entries(files: Any, folder: str) -> list[dict[str, Any]]:
    """The entries of a folder with the names of Parquet files, sorted by name: recordings, or the parts of one."""

    def is_recording(entry: dict[str, Any]) -> bool:
        path = entry["name"].rstrip("/")
        # An object storage can list the folder itself as one of its entries. macOS writes files with names such as
        # `._walk.parquet` beside others; they are not recordings.
        is_hidden = path.rsplit("/", 1)[-1].startswith(".")
        return path != folder.rstrip("/") and path.endswith(".parquet") and not is_hidden

    files.invalidate_cache(folder)
    return sorted(filter(is_recording, files.ls(folder, detail=True)), key=lambda entry: entry["name"])


def _unused(files: Any, folder: str, table: str | None, opened: set[str]) -> list[str]:
    """The reasons why files in a participant's folder that may be recordings are not used: files with an ending that differs from
    ``.parquet`` in case, and files in sub-folders. A sub-folder with the ending ``.parquet`` is a recording in parts. Hidden
    files, the files in ``opened``, which the settings name, and tables are omitted. ``table`` is the folder of the table."""
    reasons: dict[str, str] = {}
    counts: dict[str, int] = {}
    for path in sorted(files.find(folder)):
        names = path[len(folder) :].strip("/").split("/")
        first = f"{folder}/{names[0]}"
        is_in_table = any(name.startswith("participant=") for name in names) or (table and path.startswith(f"{table}/"))
        if any(name.startswith(".") for name in names) or is_in_table or path in opened:
            continue
        if not names[-1].lower().endswith(".parquet") or names[0].endswith(".parquet"):
            continue
        if names[0].lower().endswith(".parquet"):
            reasons[first] = f"{first}: the name of a recording must end in .parquet, in lower case: rename it"
        else:
            counts[first] = counts.get(first, 0) + 1
            reasons[first] = (
                f"{first}: Parquet files in a sub-folder of a participant are not used ({counts[first]}): move recordings to "
                f"{folder}; the name of a folder with the parts of one recording must end in .parquet"
            )
    return list(reasons.values())


def outside(study: str | os.PathLike[str]) -> list[str]:
    """The reasons why files at the top level of a study that may be recordings are not used: they belong to no participant."""
    files, root = fsspec.url_to_fs(_address(study))
    files.invalidate_cache(root)
    entries = sorted(((entry["name"].rstrip("/"), _is_folder(files, entry)) for entry in files.ls(root, detail=True)))
    names = ((path, path.rsplit("/", 1)[-1], is_folder) for path, is_folder in entries)
    # A folder with this ending, in lower case, is a recording in parts if it has parts; a table has folders of participants.
    found = (
        path
        for path, name, is_folder in names
        if (name.endswith(".parquet") and _parquet_entries(files, path) if is_folder else name.lower().endswith(".parquet"))
        and not name.startswith(".")
    )
    return [f"{path}: not in the folder of a participant: move it there" for path in found]


def participants(study: str, out: str) -> list[str]:
    """The names of the participants' folders in a study, sorted. Recordings in parts are not among them, and neither are folders
    of results: the folder of the table, and folders that contain this table or that of an earlier run, unless they also have
    recordings or settings."""
    files, root = fsspec.url_to_fs(study)
    files.invalidate_cache(root)
    table_files, out_path = fsspec.url_to_fs(out)
    table = out_path.rstrip("/")
    if files == table_files and table == root.rstrip("/"):
        raise OSError(f"{out}: this is the folder of the study: choose another --out")

    def has_person(path: str) -> bool:
        try:
            return bool(_parquet_entries(files, path) or files.exists(f"{path}/participant.toml"))
        except OSError:
            # The evaluation of this participant reports the reason.
            return True

    def holds_results(path: str) -> bool:
        return table == path or table.startswith(f"{path}/") or holds_table(path)

    def holds_table(path: str) -> bool:
        # Links are not followed, because they can lead back to the study.
        folders = [entry["name"].rstrip("/") for entry in files.ls(path, detail=True) if entry["type"] == "directory"]
        # An object storage can list the folder itself as one of its entries.
        names = {folder: folder.rsplit("/", 1)[-1] for folder in folders if folder != path}
        visible = [(folder, name) for folder, name in names.items() if not name.startswith(".")]
        return any(name.startswith("participant=") or is_result(folder) for folder, name in visible)

    def is_result(path: str) -> bool:
        return not has_person(path) and holds_table(path)

    def is_participant(path: str) -> bool:
        if path == table and has_person(path):
            raise OSError(f"{out}: this folder contains recordings or participant.toml: choose another --out")
        return has_person(path) or not holds_results(path)

    try:
        entries = files.ls(root, detail=True)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise OSError(f"cannot read {study}: it must be a folder with one folder per participant") from error

    paths = [entry["name"].rstrip("/") for entry in entries if _is_folder(files, entry)]
    # An object storage can list the folder itself as one of its entries.
    paths = [path for path in paths if path != root.rstrip("/")]
    named = [(path, path.rsplit("/", 1)[-1]) for path in paths]
    named = [(path, name) for path, name in named if not name.startswith(".") and not name.endswith(".parquet")]
    names = sorted(name for path, name in named if is_participant(path))
    if not names:
        raise OSError(f"{study}: no participant: it must contain one folder per participant, with recordings")
    return names


def evaluate(participant: str, study: str, out: str, options: Options) -> Outcome:
    """Fits each step of a participant, and writes the rows to the table, unless they are up to date there.

    This is the task that Dask or another engine runs: it needs nothing but its arguments, and can be repeated at any time.
    Raises a ``ValueError`` if ``options`` has a zero file.
    """
    _refuse_zero(options)
    files, root = fsspec.url_to_fs(study)
    table_files, target = _table_file(participant, out)
    try:
        table = fsspec.url_to_fs(out)[1].rstrip("/") if files == table_files else None
        return _evaluate(participant, files, f"{root}/{participant}", table_files, target, options, table)
    except (OSError, ValueError) as error:
        _remove_rows(table_files, target)
        return Outcome(participant, 0, False, (str(error),))


def _refuse_zero(options: Options) -> None:
    """Raises a ``ValueError`` if the options have a zero file, which is that of one person's insoles."""
    if options.zero is not None:
        raise ValueError(
            f"zero = {os.fspath(options.zero)!r} is for the recordings of one person: name the zero file of each participant "
            "in participant.toml"
        )


def _table_file(participant: str, out: str) -> tuple[Any, str]:
    """The file system of the table, and the path of the participant's file there."""
    files, table = fsspec.url_to_fs(out)
    return files, f"{table}/{_core.steps_path(participant)}"


def _remove_rows(files: Any, target: str) -> None:
    """Removes a participant's file of an earlier run, if there is one, so that it does not remain in the table."""
    with contextlib.suppress(FileNotFoundError):
        files.rm_file(target)


def _evaluate(
    participant: str, files: Any, folder: str, table_files: Any, target: str, options: Options, table: str | None
) -> Outcome:
    """Evaluates the recordings in ``folder``, and writes the rows to the file ``target``. ``files`` and ``table_files`` are the
    file systems of these two. ``table`` is the folder of the table, if it is in the file system of the study."""
    opened: set[str] = set()
    tissue = None if options.tissue is None else os.fspath(options.tissue)
    is_local = isinstance(files, LocalFileSystem)

    def read(path: str) -> bytes:
        if path == tissue:
            # This file is on this worker, all others are in the study.
            return pathlib.Path(path).read_bytes()
        if not is_local:
            # In an object storage, `..` is part of a name.
            protocol, mark, rest = path.rpartition("://")
            path = protocol + mark + posixpath.normpath(rest)
        elif os.path.exists(path) and not os.path.isfile(path):
            # From a device or a pipe, a program would read without end.
            raise OSError(f"{path} is not a file of zeros or of measurements of the tissue")
        opened.add(path)
        return bytes(files.cat_file(path))

    person = _core.Person.open(folder, options, read)
    # The files of each recording, by the path of the recording: the file itself, or the parts in a folder.
    recordings: dict[str, list[dict[str, Any]]] = {}
    for entry in _parquet_entries(files, folder):
        path = entry["name"].rstrip("/")
        recordings[path] = _parquet_entries(files, path) if _is_folder(files, entry) else [entry]
    unused = _unused(files, folder, table, opened)
    entries = [entry for parts in recordings.values() for entry in parts]
    stamps = [f"\n{entry['name']} {[(key, entry[key]) for key in _STAMPS if key in entry]}" for entry in entries]
    made_from = f"{_core.version} python {person.description}{''.join(stamps)}".encode()
    if (rows := _up_to_date_rows(table_files, target, made_from)) is not None:
        return _outcome(participant, rows, True, unused, person.notes)
    batches, left_out = [], []
    for path, parts in recordings.items():
        try:
            contents = [(entry["name"], files.cat_file(entry["name"])) for entry in parts]
            rows = person.rows(_core.Recording.parse(contents, path))
            if rows.num_rows == 0:
                left_out.append(f"{path}: no complete step: record a walk of several steps")
            batches.append(rows)
        except (OSError, ValueError) as error:
            left_out.append(str(error))
    steps = sum(batch.num_rows for batch in batches) // len(REGIONS)
    if steps == 0:
        found = "no complete step in its recordings" if recordings else "no recording (*.parquet)"
        problem = f"{folder}: {found}: record a walk of several steps"
        raise ValueError("; ".join([*left_out, *unused, problem]))
    # Without a description of its inputs the file is out of date, so the next run tries the unusable recordings again.
    metadata = {_MADE_FROM: b"" if left_out else made_from}
    rows_table = pyarrow.Table.from_batches(batches).replace_schema_metadata(metadata)
    _write(table_files, target, rows_table)
    return _outcome(participant, rows_table, False, left_out + unused, person.notes)


def _outcome(participant: str, rows: pyarrow.Table, is_cached: bool, left_out: list[str], notes: list[str]) -> Outcome:
    """The outcome of a participant with these rows."""
    incomplete = tuple(f"{participant}, {recording}, {region}: {defect}" for recording, region, defect in defects_of(rows))
    return Outcome(participant, rows.num_rows // len(REGIONS), is_cached, tuple(left_out), incomplete, tuple(notes))


def _up_to_date_rows(files: Any, path: str, made_from: bytes) -> pyarrow.Table | None:
    """The rows of a file that was made from these inputs, with the columns that name their defects. ``None`` if the file is
    missing, out of date or unreadable."""
    try:
        with files.open(path, "rb") as file:
            table = pyarrow.parquet.ParquetFile(file)
            if (table.metadata.metadata or {}).get(_MADE_FROM) != made_from:
                return None
            return table.read(columns=["recording", "region", "defects"])
    except (OSError, pyarrow.ArrowInvalid):
        return None


def _write(files: Any, path: str, table: pyarrow.Table) -> None:
    """Writes a file. An existing one is replaced only when the new one is complete."""
    folder = path.rsplit("/", 1)[0]
    files.makedirs(folder, exist_ok=True)
    # Two workers may write the same file if one of them was believed to be lost, so each has a temporary file of its own.
    # Programs that read the table ignore files with names that begin with a dot.
    temporary = f"{folder}/.{uuid.uuid4().hex}.part"
    try:
        with files.open(temporary, "wb") as file:
            pyarrow.parquet.write_table(table, file)
        files.mv(temporary, path)
    except BaseException:
        # The file may not exist.
        with contextlib.suppress(OSError):
            files.rm(temporary)
        raise


def _client(scheduler: str) -> distributed.Client:
    """A client of this scheduler, or of a local cluster."""
    if scheduler in ("threads", "processes"):
        is_processes = scheduler == "processes"
        # Whoever connects to a scheduler can run programs as this user, so other users of this computer must not: its processes
        # authenticate each other. The HTTP servers of Dask cannot be omitted, but serve nothing.
        with dask.config.set({f"distributed.{part}.http.routes": [] for part in ("scheduler", "worker")}):
            cluster = distributed.LocalCluster(
                n_workers=CPU_COUNT if is_processes else 1,
                threads_per_worker=1 if is_processes else CPU_COUNT,
                processes=is_processes,
                security=True if is_processes else None,
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
            )
        return distributed.Client(cluster)
    try:
        return distributed.Client(scheduler, timeout=_CONNECT_TIMEOUT)
    except (OSError, ValueError, TimeoutError) as error:
        raise ConnectionError(
            f"the scheduler {scheduler} cannot be reached: start it with `dask scheduler`, and check the address, which "
            f"has the form tls://HOST:8786 or, on a network that others cannot reach, tcp://HOST:8786 ({error})"
        ) from error


def run(
    study: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    scheduler: str = "threads",
    options: Options = Options(),
    progress: Callable[[int, int], None] | None = None,
) -> list[Outcome]:
    """Evaluates all participants of a study, and returns their outcomes in the order of their names.

    ``scheduler`` is ``threads``, ``processes``, or the address of a Dask scheduler; its workers need access to ``study`` and
    ``out``. ``progress`` receives the number of finished participants and the number of all participants. After an
    interruption, the same call evaluates only the remaining participants. Raises a ``ConnectionError`` if the scheduler cannot
    be reached or is lost, and a ``ValueError`` or an ``OSError``, before anything is changed, for options that are invalid for
    every participant.

    A ``UserWarning`` for each participant names the recordings that could not be used, the incomplete results and the
    measurements that are out of range, which the outcome has, too. Further ones name files at the top level of the study that are
    not used, and rows in the table of participants who have no folder any more.
    """
    outcomes = _outcomes(study, out, scheduler, options, progress)
    for outcome in outcomes:
        # The reasons are sentences that contain semicolons.
        reasons = [f"note: {note}" for note in outcome.notes]
        reasons += [f"left out: {reason}" for reason in outcome.left_out]
        reasons += [f"incomplete: {defect}" for defect in outcome.incomplete]
        if reasons:
            warnings.warn(f"{outcome.participant}: {' | '.join(reasons)}", stacklevel=2)
    for reason in outside(study):
        warnings.warn(f"left out: {reason}", stacklevel=2)
    for note in _notes_on_rows(out, outcomes):
        warnings.warn(note, stacklevel=2)
    return outcomes


def _outcomes(
    study: str | os.PathLike[str],
    out: str | os.PathLike[str],
    scheduler: str,
    options: Options,
    progress: Callable[[int, int], None] | None,
) -> list[Outcome]:
    """The outcomes of all participants, without warnings: see ``run``."""
    study, out = _address(study), _address(out)
    names = participants(study, out)
    _refuse_zero(options)
    # Raises an exception if the options are invalid. `evaluate` would remove the rows of an earlier run of every participant.
    _core.Person(options)
    outcomes: dict[str, Outcome] = {}
    client = _client(scheduler)
    try:
        if not client.nthreads():
            problem = f"the scheduler {scheduler} has no worker yet: start one with `dask worker {scheduler}`"
            # At the place where the user called `run`.
            warnings.warn(problem, stacklevel=3)
        # With `pure`, Dask would reuse the results of an earlier run with the same arguments, although files may have changed.
        futures = client.map(evaluate, names, study=study, out=out, options=options, pure=False)
        name_of = {future.key: name for future, name in zip(futures, names, strict=True)}
        completed = distributed.as_completed(futures)
        for future in completed:
            name = name_of[future.key]
            if future.status == "finished":
                outcomes[name] = future.result()
            elif future.status == "error":
                # The task could not remove the rows of an earlier run from the table, for example because its worker was lost.
                table_files, target = _table_file(name, out)
                reasons = [f"{name}: {future.exception()!r}"]
                try:
                    _remove_rows(table_files, target)
                except OSError as error:
                    reasons.append(f"{target}: rows of an earlier run remain: {error}")
                outcomes[name] = Outcome(name, 0, False, tuple(reasons))
            elif future.status in ("pending", "lost"):
                # Its result was lost with a worker, so another worker evaluates the participant again.
                completed.add(future)
                continue
            else:
                raise ConnectionError(
                    f"the scheduler {scheduler} was lost: run the same command again; the rows of finished participants "
                    f"are in {out}"
                )
            future.release()
            if progress is not None:
                progress(len(outcomes), len(names))
    finally:
        cluster = client.cluster
        client.close()
        if cluster is not None:
            cluster.close()
    return [outcomes[name] for name in names]


def _notes_on_rows(out: str | os.PathLike[str], outcomes: Sequence[Outcome]) -> list[str]:
    """A note on each file of the table of a participant without a folder in the study."""
    files, root = fsspec.url_to_fs(_address(out))
    known = [f"{root}/{_core.steps_path(outcome.participant)}" for outcome in outcomes]
    file_name = known[0].rsplit("/", 1)[-1]
    try:
        folders = files.ls(root, detail=False)
    except FileNotFoundError:
        # No participant has a step, so there is no table.
        return []
    paths = sorted(f"{folder.rstrip('/')}/{file_name}" for folder in folders)
    problem = "but this participant has no folder: remove the file unless you need it"
    return [f"the table has {path}, {problem}" for path in paths if path not in known and files.exists(path)]


def _address(path: str | os.PathLike[str]) -> str:
    """The path in a form that has the same meaning in every process."""
    files, root = fsspec.url_to_fs(os.fspath(expanded(path)))
    return str(files.unstrip_protocol(root.rstrip("/")))


def _options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the evaluation, which are options of ``plantar cohort``."""
    size = "European shoe size of participants without a size, a whole number from 20 to 52 [42]"
    parser.add_argument("--size", type=int, default=42, help=size)
    filters = "filter of the contact area [direct, or smoothed with --method paper]"
    parser.add_argument("--filter", choices=["direct", "live", "smoothed"], help=filters)
    method = "method of the identification [projection]"
    parser.add_argument("--method", choices=["projection", "paper"], default="projection", help=method)
    parser.add_argument("--bounds", choices=["free", "paper"], default="free", help="bounds of the exponents [free]")
    parser.add_argument("--tissue", metavar="FILE", help="tissue measurements, at the same path here and on each worker")
    compression = "assumed largest compression of the tissue, as a fraction of its thickness [0.457]"
    parser.add_argument("--compression", type=float, metavar="FRACTION", help=compression)
    for name, text in (
        ("on", "a cell comes into contact at this pressure [10]"),
        ("off", "a cell loses contact below this pressure [3/4 of --contact-on]"),
        ("full", "a cell counts with its whole area from this pressure on; 0: always [150]"),
    ):
        parser.add_argument(f"--contact-{name}", type=float, metavar="KPA", dest=f"contact_{name}_kpa", help=text)
    thresholds = "thresholds of heel strike and toe off: proportional to the peaks of the steps, or fixed [adaptive]"
    parser.add_argument("--thresholds", choices=["adaptive", "absolute"], default="adaptive", help=thresholds)
    for name, text in (
        ("strike", "heel strike is the frame in which the total force reaches this value [35]"),
        ("release", "toe off is the frame in which the total force falls below this value [70]"),
    ):
        parser.add_argument(f"--{name}", type=float, metavar="N", dest=f"{name}_n", help=text)
    for name, text in (
        ("min_stance", "a contact that is shorter than this time is not a step [90]"),
        ("min_swing", "a gap that is shorter than this time does not end a stance [50]"),
        ("max_stance", "a contact that is longer than this time is not a step [2500]"),
    ):
        parser.add_argument(f"--{name.replace('_', '-')}", type=int, metavar="MS", dest=f"{name}_ms", help=text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command. Exit status: 0 if all participants and recordings were used, 3 if some could not be used or have
    incomplete results, 2 for invalid arguments, 1 otherwise."""
    parser = argparse.ArgumentParser(prog="python -m plantar.cohort", description=__doc__)
    parser.add_argument("study", metavar="STUDY", help="the folder with one folder per participant")
    parser.add_argument("--out", required=True, metavar="TABLE", help="the folder of the table to write")
    parser.add_argument("--scheduler", default="threads", help="threads, processes or tcp://HOST:8786 [threads]")
    _options(parser)
    given = vars(parser.parse_args(arguments))
    study, out, scheduler = (given.pop(name) for name in ("study", "out", "scheduler"))
    options = dataclasses.replace(Options(), **given)

    def progress(done: int, total: int) -> None:
        if sys.stderr.isatty():
            print(f"\r{done} of {total} participants", end="\n" if done == total else "", file=sys.stderr, flush=True)

    start_s = time.monotonic()
    try:
        outcomes = _outcomes(study, out, scheduler, options, progress)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    left_out = [reason for outcome in outcomes for reason in outcome.left_out] + outside(study)
    for note in (note for outcome in outcomes for note in outcome.notes):
        print(f"note: {note}", file=sys.stderr)
    for reason in left_out:
        print(f"left out: {reason}", file=sys.stderr)
    incomplete = [defect for outcome in outcomes for defect in outcome.incomplete]
    for defect in incomplete:
        print(f"incomplete: {defect}", file=sys.stderr)
    cached_count = sum(outcome.is_cached for outcome in outcomes)
    fitted = [outcome for outcome in outcomes if outcome.steps and not outcome.is_cached]
    if cached_count == len(fitted) == 0:
        print(f"error: {study}: no step of any participant was found, for the reasons above", file=sys.stderr)
        return 1
    for note in _notes_on_rows(out, outcomes):
        print(f"note: {note}", file=sys.stderr)
    steps = sum(outcome.steps for outcome in fitted)
    print(
        f"wrote {out}: {steps} step{'' if steps == 1 else 's'} of {len(fitted)} participant{'' if len(fitted) == 1 else 's'} in "
        f"{time.monotonic() - start_s:.1f} s; participants already up to date: {cached_count}"
    )
    return 3 if left_out or incomplete else 0


if __name__ == "__main__":
    # The workers import the functions from the package, and do not know this module by the name `__main__`.
    from plantar import cohort

    sys.exit(cohort.main())
