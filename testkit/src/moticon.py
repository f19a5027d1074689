"""Reads the walks in the source archive of the Python package moticon-opengo: the text of its raw exports, and the steps in the
vendor's reports of the same walks.

The argument is the path of the archive. Prints a JSON list with an object for each walk: its "export", and "steps" with a list
for each foot, left before right. Each step is an object with the keys of COLUMNS. A value that the report lacks is null.
"""

import json
import math
import re
import sys
import tarfile
import xml.etree.ElementTree as ElementTree
import zipfile

SHEET = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
# For each walk, the part of the name of its export and of its report that differs from those of the other walks.
WALKS = [("102114", "10_21_14"), ("102137", "10_21_37"), ("102231", "10_22_31")]
# The values of a step, each with the title of its column. In the reports, double support is one phase: from initial contact of
# this foot to toe off of the other one. The step duration is the time from initial contact of this foot to that of the other
# one.
COLUMNS = {
    "contact_s": "Initial contact (s)",
    "toe_off_s": "Toe off (s)",
    "peak_n": "Max total force during stance phase (N)",
    "stride_s": "Stride time (s)",
    "to_other_s": "Step duration (s)",
    "double_support_s": "Double support (s)",
}


def table(book, number):
    """Yields the rows of a sheet, each a dictionary from the letter of a column to the text of its cell."""
    shared = ElementTree.fromstring(book.read("xl/sharedStrings.xml"))
    texts = ["".join(part.text or "" for part in item.iter(f"{SHEET}t")) for item in shared]
    for row in ElementTree.fromstring(book.read(f"xl/worksheets/sheet{number}.xml")).iter(f"{SHEET}row"):
        values = {}
        for cell in row:
            value = cell.find(f"{SHEET}v")
            if value is not None:
                # The type "s" is an index in the table of shared strings.
                is_shared = cell.get("t") == "s"
                values[re.match("[A-Z]+", cell.get("r"))[0]] = texts[int(value.text)] if is_shared else value.text
        yield values


def steps(book, number):
    """Yields the steps in a sheet that have an initial contact, with the values of COLUMNS."""
    rows = list(table(book, number))
    column = {title: letter for letter, title in rows[0].items()}
    for row in rows[1:]:
        step = {key: float(row.get(column[title], "nan")) for key, title in COLUMNS.items()}
        if not math.isnan(step["contact_s"]):
            yield {key: None if math.isnan(value) else value for key, value in step.items()}


walks = []
with tarfile.open(sys.argv[1]) as archive:
    folder = f"{archive.getnames()[0].split('/')[0]}/tests/testdata"
    for walk, report in WALKS:
        export = archive.extractfile(f"{folder}/230927_{walk}.txt").read().decode()
        book = zipfile.ZipFile(archive.extractfile(f"{folder}/gait_report_230927_{report}.xlsx"))
        walks.append({"export": export, "steps": [list(steps(book, sheet)) for sheet in (2, 3)]})
json.dump(walks, sys.stdout)
