//! A participant of a study: the settings and options for this person.

use crate::ReadFile;
use crate::options::{Search, text, virtual_insole};
use anyhow::{Context, Result};
use fit::steps::isolate;
use fit::{Options, Step};
use parameters::{InsoleSize, Participant};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{FrameSource, VirtualInsole, Zero};
use std::io;
use std::path::{Path, PathBuf};

/// The name of the file with a participant's settings, in the participant's folder.
pub const SETTINGS_FILE: &str = "participant.toml";

/// A participant and the options for this person.
#[derive(Clone, Debug)]
pub struct Person {
    /// The values of participant.toml, or none without this file.
    pub settings: Participant,
    /// The size in participant.toml, or else that of the options.
    pub size: InsoleSize,
    /// The options of the fit, for this person's size and tissue thickness.
    pub options: Options,
    /// The contact rule.
    pub contact: ContactRule,
    /// The stance rule.
    pub stance: StanceRule,
    /// A note on each value of the tissue measurements that is out of range and therefore not used.
    pub notes: Vec<String>,
    /// The file with the readings of the unloaded cells, and its content.
    zero: Option<(PathBuf, Zero)>,
}

impl Person {
    /// The participant in this folder, with the settings in its `participant.toml`, if there is one.
    ///
    /// # Errors
    /// Fails if a file cannot be read or used, or an option is out of range.
    pub fn open(
        folder: &Path,
        search: &Search,
        contact: ContactRule,
        stance: StanceRule,
        read: ReadFile,
    ) -> Result<Self> {
        let path = folder.join(SETTINGS_FILE);
        let settings = match read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Participant::default(),
            content => Participant::parse(&text(&path, content)?, &path)?,
        };
        Self::new(settings, search, contact, stance, read)
    }

    /// A participant with these settings.
    ///
    /// # Errors
    /// Fails if a file cannot be read or used, or an option is out of range.
    pub fn new(
        settings: Participant,
        search: &Search,
        contact: ContactRule,
        stance: StanceRule,
        read: ReadFile,
    ) -> Result<Self> {
        let size = settings.size.unwrap_or(search.size);
        let search = Search { size, tissue: settings.tissue.clone().or(search.tissue.clone()), ..search.clone() };
        let (tissue, notes) = search.tissue(read)?;
        let read_zero =
            |path: &PathBuf| Ok::<_, anyhow::Error>((path.clone(), Zero::parse(&text(path, read(path))?, path)?));
        let zero = settings.zero.as_ref().map(read_zero).transpose()?;
        let no_resamples = 0;
        Ok(Self { size, options: search.options(&tissue, no_resamples)?, contact, stance, notes, zero, settings })
    }

    /// Everything that determines this person's rows in the table of a cohort, except the recordings and the version of the
    /// program, as text.
    pub fn description(&self) -> String {
        let Self { settings, size, options, contact, stance, zero, .. } = self;
        format!("{size} {settings:?} {options:?} {contact:?} {stance:?} {zero:?}")
    }

    /// The virtual insole of a recording, with the zeros of this person's zero file, if there is one.
    ///
    /// # Errors
    /// Fails if no insole supports the recording's frame rate, the recording cannot be read, or the zero file is for other cells.
    pub fn insole(&self, source: &FrameSource) -> Result<VirtualInsole> {
        let mut insole = virtual_insole(source, self.contact, self.stance)?;
        if let Some((path, zero)) = &self.zero {
            zero.apply_to(&mut insole, &path.display().to_string())?;
        }
        Ok(insole)
    }

    /// The complete steps of a recording.
    ///
    /// # Errors
    /// Fails if the recording cannot be evaluated. Messages name `path`.
    pub fn steps(&self, source: FrameSource, path: &Path) -> Result<Vec<Step>> {
        let steps = || {
            let insole = self.insole(&source)?;
            // Each recording is evaluated on its own, so its index is 0.
            let (steps, _excluded) = isolate(&insole, insole.scans(source), 0, &mut |_| ())?;
            Ok::<_, anyhow::Error>(steps)
        };
        steps().with_context(|| format!("{}: the recording cannot be evaluated", path.display()))
    }
}
