//! Reads the numbers and texts in the first sheet of an Excel file, version 97 to 2003 (BIFF8 in a compound file). The results of
//! formulas are not read.
//!
//! The library for compound files checks the container. The records are read here, because the libraries for Excel files
//! allocate memory for all rows and columns up to the largest ones that a file claims, which may be more than the memory of a
//! computer.
//!
//! Source: Microsoft, [MS-XLS]: Excel Binary File Format (.xls) Structure, sections 2.1.4, 2.4 and 2.5.

use cfb::CompoundFile;
use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::rc::Rc;

/// Types of records. Their names are those of [MS-XLS].
const BOF: u16 = 0x0809;
const EOF: u16 = 0x000a;
const SST: u16 = 0x00fc;
const CONTINUE: u16 = 0x003c;
const NUMBER: u16 = 0x0203;
const RK: u16 = 0x027e;
const MULRK: u16 = 0x00bd;
const LABEL_SST: u16 = 0x00fd;
/// Type in the BOF record of a substream that is a worksheet.
const WORKSHEET: u16 = 0x0010;
/// Number of columns of a sheet.
const MAX_COLUMNS: usize = 256;

/// The rows of the first sheet, each with the contents of its cells as text. The text of an empty cell is empty. A row without
/// cells is empty. Cells that refer to the same text share it: a small file may refer to a long text very often.
///
/// # Errors
/// Fails with the reason if the file is damaged.
pub fn rows(bytes: &[u8]) -> Result<Vec<Vec<Rc<str>>>, String> {
    let mut file = CompoundFile::open(Cursor::new(bytes)).map_err(|error| error.to_string())?;
    let stream = file.open_stream("/Workbook").map_err(|error| error.to_string())?;
    let mut workbook = Vec::new();
    // A damaged file may claim a stream that is longer than the file.
    stream.take(bytes.len() as u64).read_to_end(&mut workbook).map_err(|error| error.to_string())?;
    let records = records(&workbook);
    let is_sheet = |(id, data): &(u16, &[u8])| *id == BOF && u16_at(data, 2) == Some(WORKSHEET);
    let sheet_start = records.iter().position(is_sheet).ok_or("no sheet")?;
    // Without the record that ends the sheet, rows may be missing: the sheet is cut off, or a damaged length exceeds the stream.
    let sheet_length = records[sheet_start..].iter().position(|(id, _)| *id == EOF).ok_or_else(|| {
        let byte: usize = records.iter().map(|(_, data)| 4 + data.len()).sum();
        format!(
            "the sheet has no end: no whole record begins at byte {byte} of the {} bytes of the workbook",
            workbook.len()
        )
    })?;
    let texts: Vec<Rc<str>> = texts(&records[..sheet_start]).into_iter().map(Rc::from).collect();
    let empty: Rc<str> = Rc::from("");
    let mut cells: BTreeMap<usize, Vec<Rc<str>>> = BTreeMap::new();
    for (id, data) in &records[sheet_start..sheet_start + sheet_length] {
        let (Some(row), Some(column)) = (u16_at(data, 0), u16_at(data, 2)) else { continue };
        let mut set = |column: usize, text: Rc<str>| {
            let fields = cells.entry(row.into()).or_default();
            if column < MAX_COLUMNS {
                fields.resize(fields.len().max(column + 1), Rc::clone(&empty));
                fields[column] = text;
            }
        };
        match *id {
            NUMBER => {
                if let Some(value) = data.get(6..14).and_then(|bytes| bytes.try_into().ok()).map(f64::from_le_bytes) {
                    set(column.into(), value.to_string().into());
                }
            }
            RK => {
                if let Some(rk) = u32_at(data, 6) {
                    set(column.into(), rk_value(rk).to_string().into());
                }
            }
            // The numbers of successive columns, each after the index of its format.
            MULRK => {
                let list = data.get(4..data.len().saturating_sub(2)).unwrap_or_default();
                for (i, entry) in list.as_chunks::<6>().0.iter().enumerate() {
                    set(usize::from(column) + i, rk_value(u32_at(entry, 2).unwrap_or(0)).to_string().into());
                }
            }
            LABEL_SST => {
                let text = u32_at(data, 6).and_then(|index| texts.get(index as usize));
                let text = text.ok_or("a cell refers to a text that the table of texts does not contain")?;
                set(column.into(), Rc::clone(text));
            }
            _ => {}
        }
    }
    let last = cells.keys().next_back().map_or(0, |row| row + 1);
    Ok((0..last).map(|row| cells.remove(&row).unwrap_or_default()).collect())
}

/// Splits a stream into records, each a type and its data, up to the first one that is not whole.
fn records(stream: &[u8]) -> Vec<(u16, &[u8])> {
    let (mut records, mut rest) = (Vec::new(), stream);
    while let (Some(id), Some(len)) = (u16_at(rest, 0), u16_at(rest, 2)) {
        let Some(data) = rest.get(4..4 + usize::from(len)) else { break };
        records.push((id, data));
        rest = &rest[4 + usize::from(len)..];
    }
    records
}

/// The value of a record's RK number. Its upper 30 bits are an integer if bit 1 is set, and otherwise the leading bits of a
/// double. The value is divided by 100 if bit 0 is set.
fn rk_value(rk: u32) -> f64 {
    let value = match rk & 2 {
        0 => f64::from_bits(u64::from(rk & !3) << 32),
        _ => f64::from(rk as i32 >> 2),
    };
    if rk & 1 == 0 { value } else { value / 100.0 }
}

/// The table of texts to which cells refer. It begins in a record SST, which records CONTINUE may follow.
fn texts(records: &[(u16, &[u8])]) -> Vec<String> {
    let Some(start) = records.iter().position(|(id, _)| *id == SST) else { return Vec::new() };
    let continued = records[start + 1..].iter().take_while(|(id, _)| *id == CONTINUE).map(|(_, data)| *data);
    let records = std::iter::once(records[start].1).chain(continued).collect();
    let mut data = ContinuedData { records, record: 0, position: 0 };
    let mut texts = Vec::new();
    // The first 8 bytes, the number of references to texts and the number of texts, are not needed.
    data.bytes(8);
    while let Some(text) = data.text() {
        texts.push(text);
    }
    texts
}

/// Reads the data of a record and of the records that continue it.
struct ContinuedData<'a> {
    /// The data of each record.
    records: Vec<&'a [u8]>,
    /// Index of the record with the next byte.
    record: usize,
    /// Position of the next byte in this record.
    position: usize,
}

impl ContinuedData<'_> {
    /// The next byte.
    fn byte(&mut self) -> Option<u8> {
        while self.position >= self.records.get(self.record)?.len() {
            (self.record, self.position) = (self.record + 1, 0);
        }
        let byte = self.records[self.record][self.position];
        self.position += 1;
        Some(byte)
    }

    /// The next `count` bytes as a little-endian number.
    fn bytes(&mut self, count: usize) -> Option<usize> {
        let mut value = 0;
        for i in 0..count {
            value |= usize::from(self.byte()?).checked_shl(8 * i as u32).unwrap_or(0);
        }
        Some(value)
    }

    /// The next text.
    fn text(&mut self) -> Option<String> {
        let length = self.bytes(2)?;
        let mut flags = self.byte()?;
        let runs = if flags & 8 != 0 { self.bytes(2)? } else { 0 };
        let extension = if flags & 4 != 0 { self.bytes(4)? } else { 0 };
        let mut units = Vec::new();
        for _ in 0..length {
            // A record that continues the characters begins with flags, of which bit 0 states their width.
            if self.position >= self.records.get(self.record)?.len() {
                flags = self.byte()?;
            }
            let width = if flags & 1 != 0 { 2 } else { 1 };
            units.push(self.bytes(width)? as u16);
        }
        for _ in 0..runs * 4 + extension {
            self.byte()?;
        }
        Some(String::from_utf16_lossy(&units))
    }
}

fn u16_at(data: &[u8], at: usize) -> Option<u16> {
    data.get(at..at + 2).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]]))
}

fn u32_at(data: &[u8], at: usize) -> Option<u32> {
    data.get(at..at + 4).and_then(|bytes| bytes.try_into().ok()).map(u32::from_le_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn numbers_of_30_bits_are_decoded() {
        // The four encodings: a double, an integer in hundredths, an integer, and a double in hundredths.
        assert_eq!(rk_value(1.0f64.to_bits().wrapping_shr(32) as u32), 1.0);
        assert_eq!(rk_value(123 << 2 | 3), 1.23);
        assert_eq!(rk_value((-7i32 << 2) as u32 | 2), -7.0);
        assert_eq!(rk_value((150.0f64.to_bits() >> 32) as u32 | 1), 1.5);
    }

    #[test]
    fn texts_continue_in_further_records_in_another_width() {
        let first = [&[2, 0, 0, 0, 2, 0, 0, 0][..], &[3, 0, 0, b'a', b'b', b'c'], &[4, 0, 0, b'd', b'e']].concat();
        // The last two characters have two bytes each.
        let second = [1, b'f', 0, 0x3b, 0x26];
        let texts = texts(&[(SST, &first), (CONTINUE, &second), (EOF, &[])]);
        assert_eq!(texts, ["abc", "def☻"]);
    }

    /// A record with this data.
    fn record(id: u16, data: &[u8]) -> Vec<u8> {
        [&id.to_le_bytes()[..], &(data.len() as u16).to_le_bytes(), data].concat()
    }

    /// An Excel file with one text in its table of texts, and a sheet with cells that refer to it, each at a row and a column.
    fn file(text: &str, cells: &[[u16; 2]]) -> Vec<u8> {
        // The number of references and of texts, and the number of characters, each of which has one byte.
        let table = [&[1, 0, 0, 0, 1, 0, 0, 0][..], &(text.len() as u16).to_le_bytes(), &[0], text.as_bytes()].concat();
        let mut workbook = [record(SST, &table), record(BOF, &[0, 6, WORKSHEET as u8, 0])].concat();
        for [row, column] in cells {
            // After row and column follow the index of the format and that of the text.
            let place = [row.to_le_bytes(), column.to_le_bytes(), [0; 2], [0; 2], [0; 2]];
            workbook.extend(record(LABEL_SST, place.as_flattened()));
        }
        workbook.extend(record(EOF, &[]));
        let mut file = CompoundFile::create(Cursor::new(Vec::new())).unwrap();
        file.create_stream("/Workbook").unwrap().write_all(&workbook).unwrap();
        file.flush().unwrap();
        file.into_inner().into_inner()
    }

    #[test]
    fn cells_that_refer_to_the_same_text_share_it() {
        let long = "Rectangle height ".repeat(400);
        let rows = rows(&file(&long, &[[0, 0], [0, 2], [3, 1]])).unwrap();
        assert_eq!(rows.iter().map(Vec::len).collect::<Vec<_>>(), [3, 0, 0, 2]);
        let texts = [&rows[0][0], &rows[0][2], &rows[3][1]];
        assert!(texts.iter().all(|text| ***text == *long && text.as_ptr() == texts[0].as_ptr()));
        assert!(rows[0][1].is_empty() && rows[3][0].is_empty());
    }
}
