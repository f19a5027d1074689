//! Parsing of text tables, with errors that name file and line.

use crate::text::shortened;
use crate::{Error, Result};
use csv::{ErrorKind, Position, Reader, ReaderBuilder, StringRecord, Trim};
use std::io::{self, BufRead, BufReader, Chain, Cursor, Read};
use std::path::Path;

/// The text of a CSV file. If the fields are separated by semicolons, as in the files of a spreadsheet in a region with decimal
/// commas, a point replaces each comma.
pub struct Text<R> {
    bytes: Chain<Cursor<Vec<u8>>, BufReader<R>>,
    /// True if semicolons separate the fields, so that commas are decimal commas.
    pub has_decimal_commas: bool,
}

impl<R: Read> Read for Text<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.bytes.read(buffer)?;
        if self.has_decimal_commas {
            buffer[..read].iter_mut().filter(|byte| **byte == b',').for_each(|byte| *byte = b'.');
        }
        Ok(read)
    }
}

/// A CSV reader that accepts lines with any number of fields. [`check_width`] checks the number instead, and has a better
/// message. Semicolons separate the fields if the header contains one, because no name of a column does; otherwise commas do.
///
/// # Errors
/// Fails if the header cannot be read. The message names `file`.
pub fn open<R: Read>(from: R, file: &Path) -> Result<Reader<Text<R>>> {
    let (mut rest, mut header) = (BufReader::new(from), Vec::new());
    while rest.read_until(b'\n', &mut header).map_err(Error::io(file))? > 0 && header.trim_ascii().is_empty() {}
    let has_decimal_commas = header.contains(&b';');
    let delimiter = if has_decimal_commas { b';' } else { b',' };
    let text = Text { bytes: Cursor::new(header).chain(rest), has_decimal_commas };
    Ok(ReaderBuilder::new().trim(Trim::All).flexible(true).delimiter(delimiter).from_reader(text))
}

/// The header of a CSV file, its first line.
///
/// # Errors
/// Fails if the file cannot be read or is empty, or if tabs separate its fields.
pub fn header<R: Read>(reader: &mut Reader<R>, file: &Path) -> Result<StringRecord> {
    let header = reader.headers().map_err(|error| unreadable(file, error))?.clone();
    if header.is_empty() {
        return Err(Error::content(at_line(file, 1), "the file is empty", "export or write it again"));
    }
    // No name of a column contains a tab.
    match header.get(0).unwrap_or_default().contains('\t') {
        true => Err(tabs(file)),
        false => Ok(header),
    }
}

/// The error for a CSV file in which tabs separate the fields.
pub fn tabs(file: &Path) -> Error {
    Error::content(
        at_line(file, 1),
        "a tab separates the fields, expected `,` with decimal points or `;` with decimal commas",
        "save the file as CSV, with commas or semicolons between the fields",
    )
}

/// Determines the line numbers of CSV records.
pub struct Lines {
    /// Number of lines that the reader counts too few after a record: it counts the line feed after a carriage return only with
    /// the next record.
    uncounted: u64,
}

impl Lines {
    /// For a reader that has read nothing but the header, which is one line.
    pub fn after_header<R: Read>(reader: &Reader<R>) -> Self {
        Self { uncounted: 2_u64.saturating_sub(reader.position().line()) }
    }

    /// The line of the record that was read last, which has this position.
    pub fn of<R: Read>(&self, reader: &Reader<R>, record: Option<&Position>) -> u64 {
        // The position of a record after blank lines is that of the first blank line, and the last record of a file may have no
        // line feed at its end.
        (reader.position().line() - 1).max(record.map_or(0, Position::line)) + self.uncounted
    }
}

/// The text `file:line` for messages.
pub fn at_line(file: &Path, line: u64) -> String {
    format!("{}:{line}", file.display())
}

/// The name of a file without its folder, for [`crate::Recording::source`].
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Converts an error of the CSV reader: I/O, or text that is not UTF-8.
pub fn unreadable(file: &Path, error: csv::Error) -> Error {
    let place = match error.position() {
        Some(position) => at_line(file, position.line()),
        None => file.display().to_string(),
    };
    let problem = error.to_string();
    match error.into_kind() {
        ErrorKind::Io(reason) => Error::io(file)(reason),
        _ => Error::content(place, problem, "save the file as plain CSV in UTF-8"),
    }
}

/// Parses a finite number. Messages name `column` and begin with `place`, the file and the line.
pub fn number(field: &str, column: &str, place: &dyn Fn() -> String) -> Result<f64> {
    match field.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ if field.is_empty() => Err(empty_field(column, place)),
        _ => Err(Error::content(
            place(),
            format!("`{}` in column {} is not a finite number", shortened(field), shortened(column)),
            "write a finite number, with a point as the decimal separator",
        )),
    }
}

/// The error for an empty field, as in the rows below the data that a spreadsheet may add.
pub fn empty_field(column: &str, place: &dyn Fn() -> String) -> Error {
    Error::content(
        place(),
        format!("an empty field in column {}", shortened(column)),
        "fill the field; if the rows at the end of the file are empty, delete them",
    )
}

/// The error for a second measurement in a file. Messages begin with `place`, the line where it begins.
pub fn another_measurement(place: String) -> Error {
    Error::content(place, "another measurement begins here", "export each measurement to a file of its own")
}

/// Checks that the time of a line is later than that of the previous line.
pub fn check_later(now_s: f64, before_s: Option<f64>, place: &dyn Fn() -> String) -> Result<()> {
    let (problem, remedy) = match before_s {
        Some(before_s) if now_s == before_s => (
            format!("time {now_s} s is repeated"),
            "if the times are rounded, export them with more digits; if the frame is a duplicate, remove it",
        ),
        Some(before_s) if now_s < before_s => {
            (format!("time runs backwards from {before_s} s to {now_s} s"), "sort the frames by time")
        }
        _ => return Ok(()),
    };
    let remedy = format!("{remedy}; if another measurement begins here, move it to a file of its own");
    Err(Error::content(place(), problem, remedy))
}

/// Checks that blanks or tabs separate the fields of a header, and neither semicolons nor commas.
pub fn check_blanks(row: &str, place: &dyn Fn() -> String) -> Result<()> {
    let Some(separator) = row.chars().find(|c| [';', ','].contains(c)) else { return Ok(()) };
    let problem = format!("`{separator}` separates the fields, expected blanks or tabs");
    Err(Error::content(place(), problem, "export the measurement as ASCII, and do not convert the file"))
}

/// Checks that a line has as many fields as the header.
pub fn check_width(found: usize, expected: usize, place: &dyn Fn() -> String) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(Error::content(
        place(),
        format!("{found} columns, the header has {expected}"),
        "give every line as many fields as the header, with the same separator",
    ))
}
