//! `plantar fit`: identifies personal parameters from recordings and live streams.

pub mod live;
mod results;
mod sensitivity;

use crate::paths::{check_folders, check_written};
use crate::print_note;
use crate::replay::{progress, write_text};
use crate::setup::{self, ContactArgs, StanceArgs, ZeroArgs};
use crate::tables::check_json;
use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use fit::fixed::COMPRESSION;
use fit::interval::RESAMPLES;
use fit::{Filter, Method, Options, Step, Study};
use live::LiveSource;
use parameters::{BOTH, InsoleSize, Parameters, TissueMeasurements};
use plantar::Side;
use plantar::checksum::crc32;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{FrameSource, Layout, RecordingReader, output, without_side};
use std::collections::BTreeSet;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Identifies a person's tissue parameters from recordings of walking.
///
/// Give any number of recordings of one person: several trials, both feet. Complete steps are extracted with the insole's own
/// code, and each region is fitted separately. A recorded live stream is a source, too: a .plantar file that the page or
/// `plantar serve --record` wrote, or the folder that `plantar record` wrote. Its areas were measured by the insole, with the
/// insole's contact rule. Send the resulting file to an insole with `plantar params push`, and use it in
/// `plantar replay` and `plantar emulate` with --params.
///
/// Exit status: 0 if all eight regions were fitted with complete results; 3 if only some were, or if a part of a region's result
/// is missing or must not be used, for example because measurements contradict each other or because the insole shifted; 2
/// if the arguments are wrong; 1 otherwise, for example if no region was fitted.
#[derive(Args)]
pub struct Fit {
    /// The recordings and recorded live streams, all of one person.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The parameter file to write [default: params.toml; required if that file has the parameters of another person or foot, or
    /// is no parameter file].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a report with pictures to this HTML file, which can be read without a network. For the report, the fit is repeated
    /// with other contact rules, filters and steps, unless the method is that of the paper.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the pictures of the report to this PNG file.
    #[cfg(feature = "png")]
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Write all results to this JSON file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Name of the person [default: the file name of the first recording; for both feet, without the name of the foot].
    #[arg(long, value_name = "NAME")]
    participant: Option<String>,
    /// Use only these steps of every recording: a number N or a range N-M. The report and `plantar replay` show the numbers.
    /// Steps and load bouts of a recording are numbered together, from 0; in a live stream the insole has numbered them, together
    /// with its alerts.
    #[arg(long, value_name = "STEPS")]
    steps: Option<StepRange>,
    #[command(flatten)]
    search: Search,
    #[command(flatten)]
    contact: ContactArgs,
    #[command(flatten)]
    stance: StanceArgs,
    #[command(flatten)]
    zero: ZeroArgs,
}

/// The options of the identification: filter, method, bounds, and the thickness and compression of the tissue.
#[derive(Clone, Args)]
pub struct Search {
    /// The filter of the contact area: that of the step records of an insole (direct), that of its live stream (live) or, for
    /// comparison, the smoothing of the paper (smoothed). The parameters are valid only for this filter [default: direct, or
    /// smoothed with --method paper].
    #[arg(long, value_enum)]
    filter: Option<FilterName>,
    /// The search: five parameters, with the distribution among people as prior (projection) or, for comparison, the paper's
    /// search for eight parameters from ten random starts, which fits the smoothed force (paper).
    #[arg(long, value_enum, default_value_t = MethodName::Projection)]
    method: MethodName,
    /// The bounds of the exponents: n from -0.95 on, with the prior (free) or, for comparison, at least 0, because n is positive
    /// in the paper, by least squares without a prior (paper). Not used by --method paper.
    #[arg(long, value_enum, default_value_t = BoundsName::Free)]
    bounds: BoundsName,
    /// Measurements of the tissue: a TOML file with lines such as `heel = 17.5` for the thickness in mm, or with tables such as
    /// [heel] with thickness_mm = 17.5, peak_strain = 0.45 (largest deformation divided by thickness, from ultrasound or
    /// fluoroscopy) and curvature_mm = [35, 60] (radii of the unloaded sole, medial-lateral and heel-toe). A peak strain or a
    /// curvature determines the vertical radius C; of both, the peak strain if the thickness is given. Otherwise --size
    /// determines the thickness, and --compression C.
    #[arg(long, visible_alias = "thickness", value_name = "FILE")]
    pub(crate) tissue: Option<PathBuf>,
    /// European shoe size, a whole number from 20 to 52, to which the typical tissue thickness is scaled [default: 42].
    #[arg(long)]
    pub(crate) size: Option<InsoleSize>,
    /// Assumed largest compression of the tissue, as a fraction of its thickness. It determines the vertical radius C of regions
    /// without a measured peak strain or curvature.
    #[arg(long, value_name = "FRACTION", default_value_t = COMPRESSION)]
    compression: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum FilterName {
    Direct,
    Live,
    Smoothed,
}

#[derive(Clone, Copy, ValueEnum)]
enum BoundsName {
    Free,
    Paper,
}

#[derive(Clone, Copy, ValueEnum)]
enum MethodName {
    Projection,
    Paper,
}

/// The parameter file to write if the user does not name one.
const DEFAULT_OUT: &str = "params.toml";

/// The numbers of the first and the last step.
#[derive(Clone, Copy)]
struct StepRange(u32, u32);

impl FromStr for StepRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (first, last) = text.split_once('-').unwrap_or((text, text));
        match (first.parse(), last.parse()) {
            (Ok(first), Ok(last)) if first <= last => Ok(Self(first, last)),
            _ => Err("expected a step number N, or a range N-M with M at least N; numbers begin at 0".into()),
        }
    }
}

impl Search {
    /// These options in the form of the library `study`.
    pub fn of_study(&self) -> study::Search {
        let filter = self.filter.map(|name| match name {
            FilterName::Direct => Filter::Direct,
            FilterName::Live => Filter::Live,
            FilterName::Smoothed => Filter::Smoothed,
        });
        let method = match self.method {
            MethodName::Projection => Method::Projection,
            MethodName::Paper => Method::Paper,
        };
        study::Search {
            filter,
            method,
            has_paper_bounds: matches!(self.bounds, BoundsName::Paper),
            tissue: self.tissue.clone(),
            size: self.size.unwrap_or_default(),
            compression: self.compression,
        }
    }

    /// The options of the fit. Prints a note on stderr for each value of the tissue that is out of range, and if the size
    /// determines a thickness but is assumed or extrapolated. `resamples` is the number of bootstrap resamples of the steps.
    pub fn options(&self, resamples: u64) -> Result<Options> {
        let (options, notes) = self.options_and_notes(resamples)?;
        print_notes(&notes);
        if self.size.is_none() && options.measured.iter().any(|measured| !measured.has_thickness) {
            eprintln!(
                "note: size {} assumed for the typical thickness of the tissue; --size states it",
                InsoleSize::default()
            );
        }
        Ok(options)
    }

    /// Returns the error of invalid options, which would otherwise occur for every participant.
    pub fn check(&self) -> Result<()> {
        self.options_and_notes(0).map(|_| ())
    }

    fn options_and_notes(&self, resamples: u64) -> Result<(Options, Vec<String>)> {
        let search = self.of_study();
        let (tissue, notes) = search.tissue(&|path| fs::read(path))?;
        let options = search.options(&tissue, resamples);
        Ok((options.with_context(|| format!("--compression {}", self.compression))?, notes))
    }
}

/// Prints notes on stderr.
pub fn print_notes(notes: &[String]) {
    notes.iter().for_each(|note| print_note(&format!("note: {note}")));
}

impl Fit {
    /// A fit of the live streams of one foot, with all outputs in a folder: `params.toml`, `report.html` and `fit.json`.
    pub fn of_streams(streams: Vec<PathBuf>, participant: String, folder: &Path, search: Search) -> Self {
        Self {
            recordings: streams,
            out: Some(folder.join(DEFAULT_OUT)),
            report: Some(folder.join("report.html")),
            #[cfg(feature = "png")]
            png: None,
            json: Some(folder.join("fit.json")),
            participant: Some(participant),
            steps: None,
            search,
            contact: ContactArgs::default(),
            stance: StanceArgs::default(),
            zero: ZeroArgs::default(),
        }
    }

    /// A fit of one recording of a person with this shoe size, with the default values of the other options of the search, and
    /// with the outputs of [`Fit::of_streams`].
    pub fn of_cells(
        recording: PathBuf,
        folder: &Path,
        contact: ContactArgs,
        stance: StanceArgs,
        size: Option<InsoleSize>,
    ) -> Self {
        let search = Search {
            filter: None,
            method: MethodName::Projection,
            bounds: BoundsName::Free,
            tissue: None,
            size,
            compression: COMPRESSION,
        };
        Self { contact, stance, ..Self::of_streams(vec![recording], "the wearer".into(), folder, search) }
    }

    /// Runs the command. Returns true if all regions were fitted and no result has a defect ([`Study::is_complete`]).
    pub fn run(&self) -> Result<bool> {
        let read = self.recordings.iter().chain(&self.search.tissue).chain(&self.zero.zero);
        let written = [
            Some(self.out()),
            self.report.as_deref(),
            self.json.as_deref(),
            #[cfg(feature = "png")]
            self.png.as_deref(),
        ];
        check_written(&read.cloned().collect::<Vec<_>>(), &written)?;
        check_folders(&written)?;
        check_json(&[self.json.as_deref()], None)?;
        let (mut study, recordings) = self.fitted()?;
        if self.report.is_some() {
            study.sensitivity = Some(self.sensitivity(&study, &recordings));
        }
        self.write(&study)
    }

    /// The parameter file to write.
    fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new(DEFAULT_OUT))
    }

    /// Refuses to replace the default file if it has the parameters of another person or foot: the user has not named it.
    fn check_default_file(&self, study: &Study) -> Result<()> {
        let file = self.out();
        if self.out.is_some() || !file.exists() {
            return Ok(());
        }
        let existing = Parameters::read(file).with_context(|| {
            format!("{} exists and would be replaced: name another file with --out", file.display())
        })?;
        let side = study.side().map_or(BOTH, Side::name);
        let existing_side = existing.identified.as_ref().map_or(side, |identified| &identified.side);
        if existing.personal && (existing.subject != study.participant || existing_side != side) {
            let feet = |side| if side == BOTH { "both feet".into() } else { format!("{side} foot") };
            bail!(
                "{0} has the parameters of {1}, {2}, and those of {3}, {4}, would replace them: name another file with --out; \
                 --out {0} replaces the file",
                file.display(),
                existing.subject,
                feet(existing_side),
                study.participant,
                feet(side)
            );
        }
        Ok(())
    }

    /// True if --steps selects the step.
    fn is_used(&self, step: &Step) -> bool {
        self.steps.is_none_or(|StepRange(first, last)| (first..=last).contains(&step.number))
    }

    /// Reads the recordings and fits all regions. The sensitivity is not computed, because a wearer waits for the result.
    pub fn study(&self) -> Result<Study> {
        Ok(self.fitted()?.0)
    }

    /// Fits all regions. Returns the fitted study, and the paths of those of its sources that are recordings of all cells.
    fn fitted(&self) -> Result<(Study, Vec<&Path>)> {
        let participant = self.participant.clone().unwrap_or_else(|| stem(&self.recordings[0]));
        let inputs = self.recordings.iter().map(|path| Input::open(path)).collect::<Result<Vec<_>>>()?;
        self.check_cells_of_streams(&inputs)?;
        let mut study = Study::new(participant, self.contact_rule(&inputs)?, self.search.options(RESAMPLES)?);
        let stance = self.stance.rule()?;
        let (mut known, mut recordings) = (Vec::new(), Vec::new());
        for input in inputs {
            match input {
                Input::Recording(path) => {
                    add_cells(&mut study, path, stance, &self.zero, &mut known)?;
                    recordings.push(path);
                }
                Input::Live(sources) => sources.into_iter().try_for_each(|source| add_live(&mut study, source))?,
            }
            check_distinct_walks(&study)?;
        }
        // A live stream does not contain its layout.
        let layouts = study.sources.iter().map(|source| (source.name.as_str(), &source.layout));
        note_unless_same_sensor(layouts.filter(|(_, layout)| !layout.cells.is_empty()), "steps", "fit");
        if let Some(StepRange(first, last)) = self.steps {
            let numbers = || study.steps.iter().map(|step| step.number);
            let range = numbers().min().zip(numbers().max());
            study.steps.retain(|step| self.is_used(step));
            if let (true, Some((least, most))) = (study.steps.is_empty(), range) {
                bail!(
                    "--steps {first}-{last}: the recordings have steps {least} to {most}; the load bouts and alerts between \
                     them are not steps"
                );
            }
        }
        if self.participant.is_none() && study.side().is_none() {
            study.participant = without_side(&study.participant).into();
        }
        self.check_default_file(&study)?;
        let bar = progress(8, "regions");
        study.fit(&|_| bar.inc(1));
        bar.finish_and_clear();
        study.counted_nrmse = self.counted_nrmse(&study, &recordings);
        self.add_rejected_measurements(&mut study)?;
        Ok((study, recordings))
    }

    /// Adds the measurements that were out of range to the defects of their regions.
    fn add_rejected_measurements(&self, study: &mut Study) -> Result<()> {
        let Some(path) = &self.search.tissue else { return Ok(()) };
        for (fit, measurements) in study.fits.iter_mut().zip(TissueMeasurements::read(path)?.0) {
            if let Ok(fit) = fit {
                fit.defects.extend(measurements.rejected.iter().map(ToString::to_string));
            }
        }
        Ok(())
    }

    /// Prints and writes the results. Returns true if all regions were fitted and no result has a defect
    /// ([`Study::is_complete`]).
    pub fn write(&self, study: &Study) -> Result<bool> {
        results::print(study);
        let fitted = study.fits.iter().flatten().count();
        if fitted > 0 {
            // If writing fails or is interrupted, an existing file with the previous parameters of the wearer is unchanged.
            let toml = fit::results::to_toml(study, self.search.size.unwrap_or_default());
            output::file(self.out(), |to| to.write_all(toml.as_bytes()))?;
        }
        if let Some(path) = &self.json {
            write_text(path, &serde_json::to_string_pretty(&fit::results::to_json(study))?)?;
        }
        if let Some(path) = &self.report {
            write(path, report::html(study).as_bytes())?;
        }
        #[cfg(feature = "png")]
        if let Some(path) = &self.png {
            write(path, &report::png(study)?)?;
        }
        if fitted == 0 {
            bail!("no region could be fitted, for the reasons above; {} was not written", self.out().display());
        }
        println!("wrote {}: {fitted} of 8 regions identified{}", self.out().display(), results::incomplete(study));
        Ok(study.is_complete())
    }
}

/// A file or folder to fit.
enum Input<'p> {
    /// A recording of all cells.
    Recording(&'p Path),
    /// Live streams of one or two insoles.
    Live(Vec<LiveSource>),
}

impl<'p> Input<'p> {
    fn open(path: &'p Path) -> Result<Self> {
        Ok(live::read(path)?.map_or(Self::Recording(path), Self::Live))
    }
}

impl Fit {
    /// Refuses the recordings of the cells in a folder of `plantar record` together with this folder: both are of the same steps,
    /// which would then be predicted from copies of themselves.
    fn check_cells_of_streams(&self, inputs: &[Input]) -> Result<()> {
        for (folder, input) in self.recordings.iter().zip(inputs) {
            let (Input::Live(_), Ok(cells)) = (input, folder.join("cells").canonicalize()) else { continue };
            let is_in_folder = |path: &&PathBuf| path.canonicalize().is_ok_and(|path| path.starts_with(&cells));
            if let Some(recording) = self.recordings.iter().find(is_in_folder) {
                bail!(
                    "{} has the cells of the same walk as the live frames and steps in {}: give one of the two",
                    recording.display(),
                    folder.display()
                );
            }
        }
        Ok(())
    }

    /// The contact rule of the fit: that of the live streams, or else that of the options. Returns an error if the live streams
    /// differ in their rules, or if an option contradicts them, as --zero and those of the stance rule do.
    fn contact_rule(&self, inputs: &[Input]) -> Result<ContactRule> {
        let mut measured: Option<(ContactRule, &LiveSource)> = None;
        for input in inputs {
            let Input::Live(sources) = input else { continue };
            for source in sources {
                let Some(rule) = source.contact_rule()? else { continue };
                let (first, first_source) = measured.get_or_insert((rule, source));
                if *first != rule {
                    bail!(
                        "{} has the contact rule {}, and {} has {}: areas of different rules cannot be fitted together; fit them \
                         separately",
                        first_source.name,
                        setup::rule_in_words(first),
                        source.name,
                        setup::rule_in_words(&rule)
                    );
                }
            }
        }
        let has_live = inputs.iter().any(|input| matches!(input, Input::Live(_)));
        if has_live && self.stance.is_given() {
            bail!(
                "{} are for recordings of all cells: the insole found the steps of a live stream by its own stance rule; omit the \
                 options, and fit recordings that need them separately",
                StanceArgs::NAMES
            );
        }
        if let (true, Some(path)) = (has_live, &self.zero.zero) {
            bail!(
                "--zero {} is for recordings of all cells: the insole computed the areas and forces of a live stream; omit the \
                 option, and fit recordings that need it separately",
                path.display()
            );
        }
        let Some((rule, source)) = measured else { return self.contact.rule(None) };
        if let Some(option) = self.contact.contradiction(&rule) {
            bail!(
                "{option} contradicts {}: the insole measured its areas by the contact rule {}; omit the option",
                source.name,
                setup::rule_in_words(&rule)
            );
        }
        Ok(rule)
    }
}

/// Prints the note of [`recording::note_unless_same_sensor`] on stderr.
pub fn note_unless_same_sensor<'r>(recordings: impl Iterator<Item = (&'r str, &'r Layout)>, values: &str, verb: &str) {
    print_notes(recording::note_unless_same_sensor(recordings, values, verb).as_slice());
}

/// Refuses a live stream and a recording of the cells of the same walk, as in the folder of `plantar identify`: each step would
/// then be predicted from its copy. Both have the times of the insole's clock.
fn check_distinct_walks(study: &Study) -> Result<()> {
    let is_live = |source: usize| study.sources[source].layout.cells.is_empty();
    let us = |s: f64| (s * 1e6).round() as i64;
    let times = |source: usize| -> BTreeSet<(i64, i64)> {
        let steps = study.steps.iter().filter(|step| step.recording == source);
        steps.map(|step| (us(step.start_s), us(step.duration_s))).collect()
    };
    for second in 1..study.sources.len() {
        for first in (0..second).filter(|&first| is_live(first) != is_live(second)) {
            let [of_first, of_second] = [first, second].map(|source| &study.sources[source]);
            // A single step may begin at the same time by chance.
            if of_first.side == of_second.side && times(first).intersection(&times(second)).count() > 1 {
                bail!(
                    "{} has steps of the same walk as {}: give either the live stream or the recording of the cells",
                    of_second.name,
                    of_first.name
                );
            }
        }
    }
    Ok(())
}

/// Adds the steps of a live stream to the study. A stream may not be given twice, for example as the file of the page and as
/// that of `plantar serve`, because its steps would then be predicted from copies of themselves.
fn add_live(study: &mut Study, source: LiveSource) -> Result<()> {
    let (steps, _) = source.steps.collected(0);
    let is_copy = |step: &fit::Step| steps.iter().any(|new| new.start_s == step.start_s && new.regions == step.regions);
    if let Some(copy) = study.steps.iter().find(|step| is_copy(step)) {
        bail!("{} has the same steps as {}: give each stream once", source.name, study.sources[copy.recording].name);
    }
    source.note_masked_cells();
    Ok(study.add_live(source.name, source.origin, source.side, &source.steps)?)
}

/// Adds the steps of a recording to the study. `known` has the checksums and names of the previous
/// recordings: a recording may not be given twice, because its steps would then be predicted from copies of themselves.
fn add_cells(
    study: &mut Study,
    path: &Path,
    stance: StanceRule,
    zero: &ZeroArgs,
    known: &mut Vec<(u32, String)>,
) -> Result<()> {
    let reader = RecordingReader::open(path)?;
    // The checksum of each frame includes that of the frame before it.
    let mut checksum = 0u32;
    reader.for_each_frame(|kpa| {
        let bytes = [checksum.to_le_bytes()].into_iter().chain(kpa.iter().map(|kpa| kpa.to_le_bytes())).flatten();
        checksum = crc32(&bytes.collect::<Vec<_>>());
    })?;
    if let Some((_, name)) = known.iter().find(|(previous, _)| *previous == checksum) {
        bail!("{} is the same recording as {name}: give each recording once", path.display());
    }
    known.push((checksum, path.display().to_string()));
    let source = FrameSource::from(reader);
    let insole = study::virtual_insole(&source, study.contact, stance);
    let mut insole = insole.with_context(|| path.display().to_string())?;
    zero.apply(&mut insole)?;
    let bar = progress(source.frames() as u64, "frames");
    study
        .add(path.display().to_string(), source, &insole, &mut |done| bar.set_position(done as u64))
        .with_context(|| format!("{}: the recording cannot be evaluated", path.display()))?;
    bar.finish_and_clear();
    Ok(())
}

/// The name of a file without folder and extension.
pub fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Writes a file. After a failure, an existing file is unchanged. The message of an error names the file.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(output::file(path, |to| to.write_all(bytes))?)
}
