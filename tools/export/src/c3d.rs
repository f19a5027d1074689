//! C3D with analog channels and events, in Intel byte order and single precision. The format is described at
//! <https://www.c3d.org>.
//!
//! A file consists of blocks of 512 bytes: the header, the parameters, and the data. It has no points, so that a frame consists
//! of one sample of each analog channel.

use crate::session::{ascii, content};
use crate::{Event, EventKind, Session};
use plantar::Side;
use recording::{Result, output};
use std::io::Write;
use std::path::Path;

/// Number of bytes in a block.
const BLOCK: usize = 512;
/// Number of the first block with parameters, counted from 1.
const PARAMETER_BLOCK: u8 = 2;
/// Identifies the format, in the header and in the parameters.
const MAGIC: u8 = 0x50;
/// The code of the byte order.
const INTEL: u8 = 84;
/// The value of a word of the header which states that event labels have four characters.
const FOUR_CHARACTERS: u16 = 12345;
/// Largest frame number in the header.
const MOST_FRAMES: usize = u16::MAX as usize;
/// Largest number of elements in a dimension of a parameter.
const MOST_ELEMENTS: usize = u8::MAX as usize;
/// Largest number of blocks in the section of the parameters.
const MOST_PARAMETER_BLOCKS: usize = u8::MAX as usize;

/// Writes a C3D file. The channels have the units and descriptions of the session; the value of an absent centre of pressure is
/// 0. Event times begin with 0 at the first frame. The group `PLANTAR` has the time of this frame on the clock of the recordings
/// and the provenance of each foot.
///
/// # Errors
/// Fails if the file cannot be written, or the events exceed the section of the parameters, which has at most 127 KiB.
pub fn write(session: &Session, path: &Path) -> Result<()> {
    let events = session.events();
    // The number of the data's first block is itself a parameter, so the length of the section is computed with 0 in its place.
    let blocks = parameters(session, &events, 0).len() / BLOCK;
    if blocks > MOST_PARAMETER_BLOCKS {
        let problem = format!("{} events, more than a C3D file can hold", events.len());
        return Err(content(&session.files(), problem, "export parts of it with --from and --to, such as --to 600"));
    }
    let data_block = (usize::from(PARAMETER_BLOCK) + blocks) as u16;
    output::file(path, |to| {
        to.write_all(&header(session, data_block))?;
        to.write_all(&parameters(session, &events, data_block))?;
        let channels = session.channels();
        for i in 0..session.frames() {
            for channel in &channels {
                to.write_all(&(channel.value(i).unwrap_or(0.0) as f32).to_le_bytes())?;
            }
        }
        // The last block is not filled: some readers read the frames of a long recording up to the end of the file.
        Ok(())
    })
}

/// The header.
fn header(session: &Session, data_block: u16) -> [u8; BLOCK] {
    let mut header = [0; BLOCK];
    // Words are counted from 1 in descriptions of the format.
    let mut put = |word: usize, bytes: &[u8]| header[2 * (word - 1)..][..bytes.len()].copy_from_slice(bytes);
    put(1, &[PARAMETER_BLOCK, MAGIC]);
    // The number of analog samples in a frame, then the numbers of the first and the last frame.
    put(3, &(session.channels().len() as u16).to_le_bytes());
    put(4, &1u16.to_le_bytes());
    put(5, &(session.frames().min(MOST_FRAMES) as u16).to_le_bytes());
    // A negative scale states that all values are floating-point numbers.
    put(7, &(-1.0f32).to_le_bytes());
    put(9, &data_block.to_le_bytes());
    // The number of samples of each analog channel in a frame, and the frame rate in Hz.
    put(10, &1u16.to_le_bytes());
    put(11, &(session.rate_hz as f32).to_le_bytes());
    put(150, &FOUR_CHARACTERS.to_le_bytes());
    header
}

/// The section with the parameters, in whole blocks.
fn parameters(session: &Session, events: &[Event], data_block: u16) -> Vec<u8> {
    let channels = session.channels();
    let frames = session.frames() as u32;
    let rate_hz = session.rate_hz as f32;
    let mut to = Parameters(vec![1, MAGIC, 0, INTEL]);

    to.group(1, "POINT");
    to.integers(1, "USED", &[0]);
    // Readers take the number of frames of a longer recording from the group TRIAL.
    to.integers(1, "FRAMES", &[frames.min(MOST_FRAMES as u32) as u16]);
    to.integers(1, "DATA_START", &[data_block]);
    to.reals(1, "SCALE", &[&[-1.0]]);
    to.reals(1, "RATE", &[&[rate_hz]]);
    to.texts(1, "UNITS", &["mm".into()]);
    to.texts(1, "LABELS", &[]);
    to.texts(1, "DESCRIPTIONS", &[]);

    to.group(2, "ANALOG");
    to.integers(2, "USED", &[channels.len() as u16]);
    to.texts(2, "LABELS", &channels.iter().map(|channel| channel.name()).collect::<Vec<_>>());
    to.texts(2, "DESCRIPTIONS", &channels.iter().map(|channel| channel.quantity.description()).collect::<Vec<_>>());
    to.texts(2, "UNITS", &channels.iter().map(|channel| channel.quantity.unit().into()).collect::<Vec<_>>());
    to.reals(2, "GEN_SCALE", &[&[1.0]]);
    to.reals(2, "SCALE", &vec![&[1.0][..]; channels.len()]);
    to.integers(2, "OFFSET", &vec![0; channels.len()]);
    to.reals(2, "RATE", &[&[rate_hz]]);

    to.group(3, "TRIAL");
    to.integers(3, "ACTUAL_START_FIELD", &[1, 0]);
    to.integers(3, "ACTUAL_END_FIELD", &[frames as u16, (frames >> 16) as u16]);
    to.reals(3, "CAMERA_RATE", &[&[rate_hz]]);

    to.group(4, "EVENT");
    to.integers(4, "USED", &[events.len() as u16]);
    let context = |event: &Event| if event.side == Side::Left { "Left" } else { "Right" }.into();
    let label = |event: &Event| if event.kind == EventKind::HeelStrike { "Foot Strike" } else { "Foot Off" }.into();
    let time = |event: &Event| {
        let t_s = event.t_s - session.t_s[0];
        let minutes = (t_s / 60.0).floor();
        [minutes as f32, (t_s - minutes * 60.0) as f32]
    };
    to.texts(4, "CONTEXTS", &events.iter().map(context).collect::<Vec<_>>());
    to.texts(4, "LABELS", &events.iter().map(label).collect::<Vec<_>>());
    let times: Vec<_> = events.iter().map(time).collect();
    to.reals(4, "TIMES", &times.iter().map(|time| &time[..]).collect::<Vec<_>>());
    // Icon numbers as written by the usual motion-capture programs: 1 foot strike, 2 foot off.
    let icon = |event: &Event| if event.kind == EventKind::HeelStrike { 1 } else { 2 };
    to.integers(4, "ICON_IDS", &events.iter().map(icon).collect::<Vec<_>>());

    to.group(5, "PLANTAR");
    // A text, because a real in single precision resolves some milliseconds of a time of day only.
    let start_s = (session.t_s[0] * 1e6).round() / 1e6;
    to.texts(5, "START_S", &[start_s.to_string()]);
    for foot in &session.feet {
        let name = if foot.side == Side::Left { "SOURCE_LEFT" } else { "SOURCE_RIGHT" };
        to.texts(5, name, &lines(&foot.source));
    }
    to.finish()
}

/// A text in ASCII, as lines of at most [`MOST_ELEMENTS`] characters. A line ends at a space of the text if it contains one.
fn lines(text: &str) -> Vec<String> {
    let (text, mut lines) = (ascii(text), Vec::new());
    let mut rest = text.trim();
    while rest.len() > MOST_ELEMENTS {
        let end = rest[..=MOST_ELEMENTS].rfind(' ').unwrap_or(MOST_ELEMENTS);
        lines.push(rest[..end].into());
        rest = rest[end..].trim_start();
    }
    lines.extend((!rest.is_empty()).then(|| rest.into()));
    lines
}

/// The bytes of the section with the parameters.
struct Parameters(Vec<u8>);

impl Parameters {
    /// Begins a group with this number, from 1 on.
    fn group(&mut self, group: i8, name: &str) {
        self.entry(-group, name, &[]);
    }

    /// Adds integers of 16 bits.
    fn integers(&mut self, group: i8, name: &str, values: &[u16]) {
        let rows: Vec<_> = values.iter().map(|value| value.to_le_bytes()).collect();
        self.rows(group, name, 2, None, &rows.iter().map(|row| &row[..]).collect::<Vec<_>>());
    }

    /// Adds rows of equal numbers of reals.
    fn reals(&mut self, group: i8, name: &str, rows: &[&[f32]]) {
        let columns = rows.first().map_or(1, |row| row.len());
        let rows: Vec<Vec<u8>> = rows.iter().map(|row| row.iter().flat_map(|v| v.to_le_bytes()).collect()).collect();
        let columns = (columns > 1).then_some(columns as u8);
        self.rows(group, name, 4, columns, &rows.iter().map(|row| &row[..]).collect::<Vec<_>>());
    }

    /// Adds ASCII texts, padded with spaces to equal length.
    fn texts(&mut self, group: i8, name: &str, texts: &[String]) {
        let length = texts.iter().map(String::len).max().unwrap_or(0);
        let rows: Vec<String> = texts.iter().map(|text| format!("{text:length$}")).collect();
        self.rows(group, name, -1, Some(length as u8), &rows.iter().map(String::as_bytes).collect::<Vec<_>>());
    }

    /// Adds rows of elements. `kind` is the code of their type: -1 for characters, 2 for integers of 16 bits, 4 for reals. A row
    /// has `columns` elements, or a single one for `None`. A dimension is at most 255, so further rows become parameters with
    /// the suffix 2, 3 and so on, as readers expect of labels.
    fn rows(&mut self, group: i8, name: &str, kind: i8, columns: Option<u8>, rows: &[&[u8]]) {
        let mut parts = rows.chunks(MOST_ELEMENTS).enumerate();
        let (_, first) = parts.next().unwrap_or_default();
        for (i, rows) in [(0, first)].into_iter().chain(parts) {
            let name = if i == 0 { name.into() } else { format!("{name}{}", i + 1) };
            // A single number is a scalar, without dimensions.
            let is_scalar = columns.is_none() && rows.len() == 1;
            let count = (!is_scalar).then_some(rows.len() as u8);
            let dimensions: Vec<u8> = columns.into_iter().chain(count).collect();
            let description_length = 0;
            let content =
                [&[kind as u8, dimensions.len() as u8], &dimensions[..], &rows.concat(), &[description_length]];
            self.entry(group, &name, &content.concat());
        }
    }

    /// Adds a parameter, or a group, which has a negative number and no content. An entry begins with the length of its name,
    /// the number of its group, the name, and the distance to the next entry.
    fn entry(&mut self, group: i8, name: &str, content: &[u8]) {
        let description_length: &[u8] = if group < 0 { &[0] } else { &[] };
        self.0.extend([name.len() as u8, group as u8]);
        self.0.extend(name.as_bytes());
        self.0.extend(((2 + description_length.len() + content.len()) as u16).to_le_bytes());
        self.0.extend(description_length);
        self.0.extend(content);
    }

    /// Ends the section: a name of length 0, and zeros to the end of the block. Its length in blocks is in the third byte.
    fn finish(mut self) -> Vec<u8> {
        self.0.resize((self.0.len() + 2).next_multiple_of(BLOCK), 0);
        self.0[2] = (self.0.len() / BLOCK) as u8;
        self.0
    }
}
