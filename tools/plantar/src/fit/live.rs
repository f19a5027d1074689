//! Live streams as sources of a fit: the stream file of `plantar serve --record` or of the web page for a phone, and the folder
//! of `plantar record`.

pub mod session;

use crate::print_note;
use crate::setup::rule_in_words;
use anyhow::{Context, Result, anyhow, bail, ensure};
use client::{DamagedAt, Entries, Entry, STREAM_INSOLES};
use fit::live::LiveSteps;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{Hello, MAJOR, ToHost, decode};
use plantar::{Region, Side};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Extension of stream files.
const EXTENSION: &str = "plantar";
/// First bytes of a Parquet file, which is a recording of all cells whatever its name.
const PARQUET: &[u8; 4] = b"PAR1";
/// Second part of the error message about a damaged entry before the first valid message: the file may be no stream file at all.
const NOT_A_STREAM: &str = "or not a recorded stream: give a file that `plantar serve --record` or the page recorded, or a \
                             recording that `plantar import` wrote";

/// The live stream of one insole.
pub struct LiveSource {
    /// Name for display.
    pub name: String,
    /// Provenance, in sentences.
    pub origin: String,
    /// The foot.
    pub side: Side,
    /// The steps.
    pub steps: LiveSteps,
}

impl LiveSource {
    /// The contact rule by which all steps were measured; `None` without steps.
    ///
    /// # Errors
    /// If steps were measured by different rules.
    pub fn contact_rule(&self) -> Result<Option<ContactRule>> {
        match self.steps.contact_rules() {
            [first, second, ..] => bail!(
                "{}: the contact rule changed during the stream, from {} to {}; areas of different rules cannot be fitted \
                 together: record each rule separately",
                self.name,
                rule_in_words(first),
                rule_in_words(second)
            ),
            rules => Ok(rules.first().copied()),
        }
    }

    /// Prints a note on stderr if cells were masked.
    pub fn note_masked_cells(&self) {
        let masked = Region::ALL.iter().zip(self.steps.masked_steps()).filter(|(_, steps)| *steps > 0);
        let regions: Vec<_> = masked.map(|(region, steps)| format!("{} in {steps} steps", region.name())).collect();
        if !regions.is_empty() {
            print_note(&format!(
                "note: {}: the readings of faulty cells were replaced by those of their neighbours: {}",
                self.name,
                regions.join(", ")
            ));
        }
    }
}

/// Reads a stream file or the folder of `plantar record`. `None` if `path` is neither: it is then taken for a recording
/// of all cells.
pub fn read(path: &Path) -> Result<Option<Vec<LiveSource>>> {
    if path.is_dir() {
        let sources = session::read(path)?;
        let cells = path.join("cells");
        if sources.is_some() && cells.is_dir() {
            print_note(&format!(
                "note: {}: the live frames and steps are used, not the cells; the recordings of the cells are the folders in {}",
                path.display(),
                cells.display()
            ));
        }
        return Ok(sources);
    }
    if !is_stream(path) {
        return Ok(None);
    }
    let sources = read_stream(path)?;
    if sources.is_empty() {
        bail!("{}: no live frames and no steps: record while the wearer walks", path.display());
    }
    Ok(Some(sources))
}

/// True for a file with the extension of stream files, unless it is a recording of all cells.
pub fn is_stream(path: &Path) -> bool {
    let mut start = [0; PARQUET.len()];
    let is_parquet = File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == *PARQUET;
    !is_parquet && path.extension().is_some_and(|extension| extension == EXTENSION)
}

/// Reads a stream file. The result has each insole that sent live frames or steps and of which the foot is known.
pub fn read_stream(path: &Path) -> Result<Vec<LiveSource>> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    from_stream(&path.display().to_string(), &bytes)
}

/// The entries of a stream file, each with its message, or `None` if this program does not know the message. If the file is
/// damaged after its first message, as after a loss of power of the computer, the entries before the damage are used, because the
/// insole has deleted their steps.
pub struct StreamMessages<'f> {
    entries: Entries<'f>,
    /// A message was decoded, so the file is a stream.
    is_stream: bool,
    damage: Option<DamagedAt>,
}

impl<'f> StreamMessages<'f> {
    /// The messages in the content of a file.
    pub fn new(file: &'f [u8]) -> Self {
        Self { entries: Entries::new(file), is_stream: false, damage: None }
    }

    /// Prints a note on stderr if the end of the file was not used. `name` is the name of the file for display.
    pub fn note_unused(&self, name: &str) {
        let rest = self.entries.rest();
        if !rest.is_empty() {
            let problem = self.damage.map_or("truncated".into(), |damage| damage.to_string());
            print_note(&format!("note: {name} is {problem}: its last {} bytes are not used", rest.len()));
        }
    }
}

impl<'f> Iterator for StreamMessages<'f> {
    type Item = Result<(Entry<'f>, Option<ToHost>)>;

    fn next(&mut self) -> Option<Self::Item> {
        match self.entries.next()? {
            Ok(entry) => {
                let message = decode(entry.message);
                self.is_stream |= message.is_some();
                Some(Ok((entry, message)))
            }
            Err(damage) if self.is_stream => {
                self.damage = Some(damage);
                None
            }
            Err(damage) => Some(Err(anyhow!("{damage}, {NOT_A_STREAM}"))),
        }
    }
}

/// The messages of one insole in a stream file.
#[derive(Default)]
struct Messages {
    hello: Option<Hello>,
    steps: LiveSteps,
    /// Number of live frames and step records.
    count: usize,
}

/// Reads the content of a stream file. `name` is the name of the file for display.
fn from_stream(name: &str, bytes: &[u8]) -> Result<Vec<LiveSource>> {
    let mut insoles: [Messages; STREAM_INSOLES] = Default::default();
    let (mut messages, mut unknown) = (StreamMessages::new(bytes), 0);
    for message in &mut messages {
        let (entry, message) = message.with_context(|| name.to_owned())?;
        let insole = &mut insoles[entry.insole];
        match message {
            Some(ToHost::Hello(hello)) if hello.major != MAJOR => bail!(
                "{name}: recorded from an insole with protocol version {}, but this program reads version {MAJOR}: use the \
                 program of that version",
                hello.major
            ),
            Some(ToHost::Hello(hello)) => {
                insole.steps.session_started();
                insole.hello = Some(hello);
            }
            Some(ToHost::Live(live)) => {
                insole.count += 1;
                insole.steps.frame(&live);
            }
            Some(ToHost::Step(step)) => {
                insole.count += 1;
                insole.steps.step(&step);
            }
            Some(_) => (),
            None => unknown += 1,
        }
    }
    messages.note_unused(name);
    if unknown > 0 {
        print_note(&format!("note: {name}: {unknown} messages are unknown to this program and were not used"));
    }
    let used: Vec<_> = insoles.into_iter().filter(|insole| insole.count > 0).collect();
    let count = used.len();
    let sources: Vec<_> = used.into_iter().filter_map(|insole| insole.into_source(name)).collect();
    if sources.len() < count {
        let problem = "the file has live frames of an insole, but neither the message that opens its session nor a step, \
                       so the foot is not known";
        ensure!(
            !sources.is_empty(),
            "{name}: {problem}: record a walk of several steps from its beginning, or omit the file"
        );
        print_note(&format!("note: {name}: {problem}: they were not used"));
    }
    Ok(sources)
}

impl Messages {
    /// The source of a fit; `None` if the foot is not known. `file` is the name of the file for display.
    fn into_source(mut self, file: &str) -> Option<LiveSource> {
        self.steps.finish();
        let side = self.steps.side().or(self.hello.as_ref().map(|hello| hello.side))?;
        let device = self.hello.map_or_else(String::new, |hello| {
            format!(" The insole had the board {}, firmware {} and {} cells.", hello.board, hello.firmware, hello.cells)
        });
        Some(LiveSource {
            name: format!("{file}, {}", side.name()),
            origin: format!("Recorded live stream of an insole.{device}"),
            side,
            steps: self.steps,
        })
    }
}
