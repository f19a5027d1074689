//! A wearer's tissue parameters as a commented TOML file: the paper's eight parameters for each of the eight regions. "The
//! paper" is DeBerardinis, Dufek, Trabia, J. Biomech. 92 (2019) 137-145.

mod defaults;
mod measurements;
mod participant;
mod scale;

pub use defaults::{InsoleSize, TypicalRange};
pub use measurements::{Measurements, OutOfRange, TissueMeasurements};
pub use participant::{Participant, Sex};
pub use scale::{AssumedShare, DeformationScale, deformation_title};

use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::model::{COEFFICIENT, Ellipsoid, ForceLaw, LENGTH_M, MAX_EXPONENT, is_within};
use plantar::pipeline::tissue::{self, AreaFilter, Tissue};
use plantar::{Region, Side};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Version of the file format.
const VERSION: u32 = 1;

/// The end of the message on a file that is not a file of parameters.
const EXPECTED: &str = "expected a file of parameters (TOML), as `plantar fit` and `plantar params` write it";

/// The reason why a file of parameters, of tissue measurements or of a participant cannot be used.
#[derive(Debug, Error)]
pub enum Error {
    /// The file cannot be read or written, with the operating system's reason.
    #[error("{0}: {1}; check the path and its permissions")]
    Io(PathBuf, std::io::Error),
    /// The file is not TOML of the required form. The message names line and column if they are known.
    #[error("{file}: {problem}")]
    Form {
        /// The file.
        file: PathBuf,
        /// The violated rule.
        problem: String,
    },
    /// A region is missing, unknown, or has a value out of range.
    #[error("{file}: [regions.{region}] {problem}")]
    Region {
        /// The file.
        file: PathBuf,
        /// Name of the region in the file.
        region: String,
        /// The violated rule and the accepted values.
        problem: String,
    },
}

/// An error for parameters that no insole can use, because they are valid only for areas that were smoothed as in the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "the parameters were identified with the paper's smoothing of the contact area, which no insole evaluates; identify them \
     again with `plantar fit --filter direct`"
)]
pub struct SmoothedArea;

/// A wearer's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// Name of the wearer, or a description of the parameters.
    pub subject: String,
    /// True if the parameters were identified from steps of the wearer.
    pub personal: bool,
    /// The conditions of the identification, if they are known.
    pub identified: Option<Identified>,
    /// The ellipsoids in the order of [`Region::ALL`], SI units.
    pub regions: [Ellipsoid<f64>; 8],
    /// Whether the scale of the deformation of each region was measured or assumed, in the order of [`Region::ALL`].
    pub deformation: [DeformationScale; 8],
}

/// The conditions of an identification. The parameters are valid only for areas with the same contact rule and filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Identified {
    /// The filter of the area: `direct` or `live`, or `smoothed`, which no insole evaluates.
    pub filter: String,
    /// The contact rule of the areas.
    pub contact: ContactRule,
    /// The foot: `left`, `right` or `both`.
    pub side: String,
    /// Number of steps.
    pub steps: u32,
    /// The regions of which the parameters were identified. Those of the other regions are typical values.
    pub regions: Vec<Region>,
}

impl Identified {
    /// The conditions in the form in which an insole stores them.
    ///
    /// # Errors
    /// If the filter is the smoothing of the paper, which no insole evaluates.
    pub fn on_insole(&self) -> Result<tissue::Identified, SmoothedArea> {
        let filter = match self.filter.as_str() {
            SMOOTHED => return Err(SmoothedArea),
            LIVE => AreaFilter::Live,
            _ => AreaFilter::Direct,
        };
        let side = [Side::Left, Side::Right].into_iter().find(|side| side.name() == self.side);
        let regions = self.regions.iter().fold(0, |regions, &region| regions | 1 << region as u8);
        Ok(tissue::Identified { contact: self.contact, filter, side, steps: self.steps, regions })
    }

    /// True if the parameters were identified from the other foot only.
    pub fn is_of_other_foot(&self, side: Side) -> bool {
        self.side != side.name() && self.side != BOTH
    }

    /// A note if the parameters were identified from the other foot only; otherwise `None`.
    pub fn other_foot_note(&self, side: Side) -> Option<String> {
        self.is_of_other_foot(side).then(|| {
            format!("the parameters were identified from the {} foot, but this is the {} foot", self.side, side.name())
        })
    }

    /// Notes for the user who sends the parameters to an insole of the foot `side`.
    pub fn notes_for_insole(&self, side: Side) -> Vec<String> {
        let untracked = self
            .invalid_for_steps()
            .map(|reason| format!("{reason}; the insole does not follow changes of the tissue with these parameters"));
        self.other_foot_note(side).into_iter().chain(untracked).collect()
    }

    /// Why the parameters are not valid for step records; `None` if they were identified with the filter of step records.
    pub fn invalid_for_steps(&self) -> Option<String> {
        match self.filter.as_str() {
            LIVE => Some(
                "the parameters were identified with the filter of the live stream: they are valid for it, but not for step \
                 records; for step records, identify them again with `plantar fit --filter direct`"
                    .into(),
            ),
            SMOOTHED => Some(SmoothedArea.to_string()),
            _ => None,
        }
    }

    /// Converts the conditions that an insole has stored.
    pub fn from_insole(stored: &tissue::Identified) -> Self {
        Self {
            filter: match stored.filter {
                AreaFilter::Direct => DIRECT,
                AreaFilter::Live => LIVE,
            }
            .into(),
            contact: stored.contact,
            side: stored.side.map_or(BOTH, Side::name).into(),
            steps: stored.steps,
            regions: Region::ALL.into_iter().filter(|&region| stored.includes(region)).collect(),
        }
    }
}

/// [`Identified::filter`] for [`AreaFilter::Direct`], the filter of the step record.
pub const DIRECT: &str = "direct";
/// [`Identified::filter`] for [`AreaFilter::Live`], the filter of the live stream.
pub const LIVE: &str = "live";
/// [`Identified::filter`] for the paper's smoothing of the area.
pub const SMOOTHED: &str = "smoothed";
/// The former name of [`SMOOTHED`], in files that were written when insoles smoothed as in the paper.
const FORMERLY_SMOOTHED: &str = "step";
/// [`Identified::side`] of parameters that were identified from both feet.
pub const BOTH: &str = "both";

/// The field `version`, which is checked before all others, because a file of another version may have other fields.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(rename = "version")]
    _version: u32,
    subject: String,
    personal: bool,
    identified: Option<FileIdentified>,
    regions: BTreeMap<String, toml::Spanned<FileRegion>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileIdentified {
    filter: String,
    contact_on_kpa: f32,
    contact_off_kpa: f32,
    contact_full_kpa: f32,
    side: String,
    steps: u32,
    /// Names of regions; all of them if the entry is missing, as in files that earlier versions of `plantar` wrote.
    regions: Option<Vec<String>>,
}

/// The entries of a region in a file; the names include the units.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileRegion {
    a_mm: f64,
    b_mm: f64,
    c_mm: f64,
    d0_mm: f64,
    k_n_m3: f64,
    n: f64,
    c_n_s_m3: f64,
    m: f64,
    /// [`DeformationScale::name`]; omitted if C follows from assumptions alone.
    deformation_scale: Option<String>,
}

impl Parameters {
    /// Reads a file and checks all values.
    ///
    /// # Errors
    /// If the file cannot be read, is not of the required form and version, or a region is missing, unknown or out of range.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let bytes = std::fs::read(path).map_err(|e| Error::Io(path.into(), e))?;
        let text = String::from_utf8(bytes).map_err(|_| Error::Form {
            file: path.into(),
            problem: format!("the file is not UTF-8 text; {EXPECTED}"),
        })?;
        Self::parse(&text, path)
    }

    /// As [`Parameters::read`], from text; messages name `path`.
    ///
    /// # Errors
    /// As [`Parameters::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let form = |problem: String| Error::Form { file: path.into(), problem };
        let malformed = |e: toml::de::Error| form(format!("{}; {EXPECTED}", message(&e)));
        let Version { version } = toml::from_str(text).map_err(malformed)?;
        if version != VERSION {
            return Err(form(format!(
                "version {version} of the format is unknown; this program reads version {VERSION}; update plantar"
            )));
        }
        let file: File = toml::from_str(text).map_err(malformed)?;
        let wrong = |region: &str, problem: String| Error::Region { file: path.into(), region: region.into(), problem };
        if let Some((name, region)) = file.regions.iter().find(|(name, _)| Region::from_name(name).is_none()) {
            let line = line_of(text, region.span().start);
            return Err(wrong(
                &name.escape_debug().to_string(),
                format!("(line {line}) is not a region; the regions are {}", region_names()),
            ));
        }
        let mut regions = [None; 8];
        let mut deformation = DeformationScale::ALL_ASSUMED;
        for ((slot, scale), region) in regions.iter_mut().zip(&mut deformation).zip(Region::ALL) {
            let Some(found) = file.regions.get(region.name()) else {
                return Err(wrong(region.name(), "is missing; provide all eight regions".into()));
            };
            let line = line_of(text, found.span().start);
            let ellipsoid =
                found.get_ref().checked().map_err(|p| wrong(region.name(), format!("(line {line}) {p}")))?;
            *slot = Some(ellipsoid);
            let name = found.get_ref().deformation_scale.as_deref();
            *scale = DeformationScale::of_file(name).map_err(|p| wrong(region.name(), format!("(line {line}) {p}")))?;
        }
        // The loop returns an error unless it fills every slot.
        let regions = regions.map(|region| region.expect("the loop fills every slot"));
        let of_name = |name: &String| {
            Region::from_name(name).ok_or_else(|| {
                form(format!("[identified] {name:?} is not a region; the regions are {}", region_names()))
            })
        };
        let identified = file.identified.map(|i| {
            Ok(Identified {
                filter: if i.filter == FORMERLY_SMOOTHED { SMOOTHED.into() } else { i.filter },
                contact: ContactRule {
                    on_kpa: i.contact_on_kpa,
                    off_kpa: i.contact_off_kpa,
                    full_kpa: i.contact_full_kpa,
                },
                side: i.side,
                steps: i.steps,
                regions: match i.regions {
                    Some(names) => names.iter().map(of_name).collect::<Result<_, Error>>()?,
                    None => Region::ALL.to_vec(),
                },
            })
        });
        let identified = identified.transpose()?;
        let is_known = |identified: &Identified| {
            [DIRECT, LIVE, SMOOTHED].contains(&identified.filter.as_str())
                && [BOTH, Side::Left.name(), Side::Right.name()].contains(&identified.side.as_str())
        };
        if identified.as_ref().is_some_and(|identified| !is_known(identified)) {
            return Err(form(
                "[identified] expected a filter of \"direct\", \"live\" or \"smoothed\", and a side of \"left\", \"right\" or \
                 \"both\""
                    .into(),
            ));
        }
        if identified.as_ref().is_some_and(|i| !i.contact.is_valid()) {
            return Err(form(
                "[identified] the contact rule is out of range: needs 0 < contact_off_kpa <= contact_on_kpa <= 1000, \
                 and contact_full_kpa of 0 or from contact_on_kpa to 2000"
                    .into(),
            ));
        }
        // The subject is printed.
        let subject = file.subject.replace(char::is_control, " ");
        Ok(Self { subject, personal: file.personal, identified, regions, deformation })
    }

    /// The regions with parameters that are typical values, or not known to be the wearer's.
    pub fn typical_regions(&self) -> Vec<Region> {
        let is_typical = |region: &Region| match &self.identified {
            _ if !self.personal => true,
            Some(identified) => !identified.regions.contains(region),
            None => false,
        };
        Region::ALL.into_iter().filter(is_typical).collect()
    }

    /// A note if parameters are typical values, or not known to be the wearer's; otherwise `None`.
    pub fn typical_note(&self) -> Option<String> {
        if !self.personal {
            let subject = &self.subject;
            return Some(format!(
                "parameters \"{subject}\" are not personal: model force and deformation are rough estimates"
            ));
        }
        let typical: Vec<_> = self.typical_regions().into_iter().map(Region::name).collect();
        (!typical.is_empty()).then(|| {
            format!(
                "the parameters of {} are typical values, or not known to be the wearer's: model force and deformation are rough \
                 estimates there",
                typical.join(", ")
            )
        })
    }

    /// The force laws of an insole as ellipsoids with the same force. A force law determines neither A / B nor d0, so A = B and
    /// d0 = C are assumed. [`Parameters::tissue`] of the result equals `tissue` bit by bit, also after a file was written and
    /// read: the rounding errors of double precision are far below half a unit in the last place of single precision.
    pub fn from_tissue(tissue: &Tissue, identified: Option<&tissue::Identified>) -> Self {
        let regions = tissue.force_laws.map(|law| {
            let law = ForceLaw::<f64>::of(&law);
            let radius_m = law.ab_m2.sqrt();
            Ellipsoid {
                a_m: radius_m,
                b_m: radius_m,
                c_m: law.c_m,
                d0_m: law.c_m,
                k: law.stiffness_pa / law.c_m,
                n: law.n,
                c: law.damping_pa_s / law.c_m,
                m: law.m,
            }
        });
        Self {
            subject: format!("pulled from an insole, parameters {:08x}", tissue.id),
            personal: identified.is_some(),
            identified: identified.map(Identified::from_insole),
            regions,
            deformation: DeformationScale::ALL_ASSUMED,
        }
    }

    /// The text of the commented file.
    pub fn to_toml(&self) -> String {
        self.to_toml_with(&|_, _| None)
    }

    /// As [`Parameters::to_toml`], with additional comments: `note` receives a region and the name of a value in the file, and
    /// may return a comment on that value.
    pub fn to_toml_with(&self, note: &dyn Fn(Region, &str) -> Option<String>) -> String {
        let mut text = String::from(
            "# Plantar tissue parameters: one viscoelastic ellipsoid for each region of the foot.\n\
             # a_mm, b_mm, c_mm  radii: medial-lateral, heel-toe, vertical\n\
             # d0_mm             thickness of the unloaded tissue\n\
             # k_n_m3, n         stiffness k (delta/d0)^n, N/m3; delta is the deformation\n\
             # c_n_s_m3, m       damping c (delta/d0)^m, N s/m3\n\
             # A force trace determines a_mm * b_mm but not a_mm / b_mm, and neither c_mm nor d0_mm: see docs/model.md.\n\n",
        );
        // Writing to a String does not fail.
        let _ = writeln!(text, "version = {VERSION}");
        let _ = writeln!(text, "subject = {}", quoted(&self.subject));
        let kind = if self.personal {
            "identified from steps of this person"
        } else {
            "not known to be identified from steps of this person"
        };
        let _ = writeln!(text, "personal = {} # {kind}", self.personal);
        if let Some(Identified { filter, contact, side, steps, regions }) = &self.identified {
            let _ = writeln!(text, "\n# The parameters hold only for areas with this filter and this contact rule.");
            let _ = writeln!(text, "# Regions that are not listed have typical values.");
            let (side, filter) = (quoted(side), quoted(filter));
            let _ = writeln!(text, "[identified]\nside = {side}\nsteps = {steps}\nfilter = {filter}");
            let _ = writeln!(text, "contact_on_kpa = {:?}\ncontact_off_kpa = {:?}", contact.on_kpa, contact.off_kpa);
            let _ = writeln!(text, "contact_full_kpa = {:?}", contact.full_kpa);
            let names: Vec<_> = regions.iter().map(|region| region.name()).collect();
            let _ = writeln!(text, "regions = {names:?}");
        }
        for ((region, e), scale) in Region::ALL.iter().zip(&self.regions).zip(self.deformation) {
            let _ = writeln!(text, "\n[regions.{}]", region.name());
            let values = [
                ("a_mm", e.a_m * 1e3),
                ("b_mm", e.b_m * 1e3),
                ("c_mm", e.c_m * 1e3),
                ("d0_mm", e.d0_m * 1e3),
                ("k_n_m3", e.k),
                ("n", e.n),
                ("c_n_s_m3", e.c),
                ("m", e.m),
            ];
            for (name, value) in values {
                let comment = note(*region, name).map_or(String::new(), |note| format!(" # {note}"));
                let _ = writeln!(text, "{name} = {value:?}{comment}");
            }
            if scale != DeformationScale::Assumed {
                let source = match scale {
                    DeformationScale::Measured => "thickness and peak strain are measured",
                    DeformationScale::AssumedThickness => "the thickness is assumed, the peak strain measured",
                    DeformationScale::AssumedCompression => {
                        "the peak strain is assumed, the thickness measured; or the curvature is measured, and Eq. 14 assumed"
                    }
                    DeformationScale::Assumed => "thickness and peak strain are assumed",
                };
                let _ = writeln!(text, "deformation_scale = {:?} # source of C: {source}", scale.name());
            }
        }
        text
    }

    /// The force laws that an insole evaluates.
    pub fn tissue(&self) -> Tissue {
        Tissue::new(self.regions.each_ref().map(|ellipsoid| ellipsoid.force_law().single()))
    }
}

/// The message of a TOML error. It repeats texts of the file, in which blanks replace control characters other than line ends:
/// they would have an effect on the terminal.
pub(crate) fn message(e: &toml::de::Error) -> String {
    e.to_string().trim_end().replace(|c: char| c.is_control() && c != '\n', " ")
}

/// The number, from 1, of the line that contains the byte at `offset`.
fn line_of(text: &str, offset: usize) -> usize {
    text[..offset].matches('\n').count() + 1
}

/// The names of all regions, for messages.
fn region_names() -> String {
    Region::ALL.map(Region::name).join(", ")
}

/// A quoted TOML string; the escapes of Rust's `Debug` are not those of TOML.
fn quoted(text: &str) -> String {
    let mut quoted = String::from('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            // Writing to a String does not fail.
            c if c.is_control() => drop(write!(quoted, "\\u{:04x}", c as u32)),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

impl FileRegion {
    /// The ellipsoid in SI units.
    ///
    /// # Errors
    /// The violated rule, if a value is out of range.
    fn checked(&self) -> Result<Ellipsoid<f64>, String> {
        let lengths = [("a_mm", self.a_mm), ("b_mm", self.b_mm), ("c_mm", self.c_mm), ("d0_mm", self.d0_mm)];
        let mm = 1e-3;
        for (name, value) in lengths {
            if !is_within(value * mm, &LENGTH_M) {
                let (least, most) = (LENGTH_M.start() / mm, LENGTH_M.end() / mm);
                return Err(format!("{name} = {value}: expected a length from {least} to {most} mm; check the unit"));
            }
        }
        for (name, value) in [("k_n_m3", self.k_n_m3), ("c_n_s_m3", self.c_n_s_m3)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(format!("{name} = {value}: expected a finite value of at least 0"));
            }
        }
        for (name, value) in [("n", self.n), ("m", self.m)] {
            // An insole uses the value in single precision, in which a value just above -1 is -1.
            let single = f64::from(value as f32);
            if !(single > -1.0 && single <= MAX_EXPONENT) {
                return Err(format!("{name} = {value}: expected an exponent above -1 and up to {MAX_EXPONENT}"));
            }
        }
        let ellipsoid = Ellipsoid {
            a_m: self.a_mm * mm,
            b_m: self.b_mm * mm,
            c_m: self.c_mm * mm,
            d0_m: self.d0_mm * mm,
            k: self.k_n_m3,
            n: self.n,
            c: self.c_n_s_m3,
            m: self.m,
        };
        let law = ellipsoid.force_law();
        if !law.single().is_valid() {
            return Err(format!(
                "results in K = k C^(n+1) / d0^n = {:e} Pa and G = c C^(m+1) / d0^m = {:e} Pa s, of which at least one is \
                 more than {:e}; check k_n_m3, c_n_s_m3, n and m",
                law.stiffness_pa,
                law.damping_pa_s,
                COEFFICIENT.end()
            ));
        }
        Ok(ellipsoid)
    }
}
