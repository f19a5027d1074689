//! A wearer's tissue parameters: the paper's eight numbers for each of the eight regions, as a commented TOML file.

mod defaults;

pub use defaults::InsoleSize;

use plantar::Region;
use plantar::insole::Tissue;
use plantar::model::{Ellipsoid, Gauge};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Version of the file format.
const VERSION: u32 = 1;

/// Why a parameter file cannot be used.
#[derive(Debug, Error)]
pub enum Error {
    /// The file cannot be read or written.
    #[error("{0}: {1}")]
    Io(PathBuf, std::io::Error),
    /// The file is no TOML of this form; the text names line and column.
    #[error("{file}: {problem}")]
    Form {
        /// The file.
        file: PathBuf,
        /// What `toml` says.
        problem: String,
    },
    /// A value that no tissue has.
    #[error("{file}: [regions.{region}] {problem}")]
    Region {
        /// The file.
        file: PathBuf,
        /// The region's name.
        region: String,
        /// What is wrong and what is needed.
        problem: String,
    },
}

/// A wearer's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// Whose they are, or what they stand for.
    pub subject: String,
    /// Identified from the wearer's own steps.
    pub personal: bool,
    /// In the order of [`Region::ALL`], SI units.
    pub regions: [Ellipsoid<f64>; 8],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    subject: String,
    personal: bool,
    regions: BTreeMap<String, toml::Spanned<FileRegion>>,
}

/// One region as it stands in a file: lengths in mm.
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
}

impl Parameters {
    /// Reads a file and checks every value.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::Io(path.into(), e))?;
        Self::parse(&text, path)
    }

    /// As [`Parameters::read`], from text; `path` is for messages.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let form = |problem: String| Error::Form { file: path.into(), problem };
        let file: File = toml::from_str(text).map_err(|e| form(e.to_string().trim_end().into()))?;
        if file.version != VERSION {
            return Err(form(format!(
                "version {} is not known; this program reads version {VERSION}: update it",
                file.version
            )));
        }
        let wrong = |region: &str, problem: String| Error::Region { file: path.into(), region: region.into(), problem };
        let line = |offset: usize| text[..offset].matches('\n').count() + 1;
        if let Some((name, region)) = file.regions.iter().find(|(name, _)| Region::from_name(name).is_none()) {
            let names: Vec<_> = Region::ALL.iter().map(|r| r.name()).collect();
            let line = line(region.span().start);
            return Err(wrong(name, format!("(line {line}) is no region; the regions are {}", names.join(", "))));
        }
        let mut regions = [None; 8];
        for (slot, region) in regions.iter_mut().zip(Region::ALL) {
            let Some(found) = file.regions.get(region.name()) else {
                return Err(wrong(region.name(), "is missing; all eight regions are needed".into()));
            };
            let line = line(found.span().start);
            let ellipsoid = found.get_ref().check().map_err(|p| wrong(region.name(), format!("(line {line}) {p}")))?;
            *slot = Some(ellipsoid);
        }
        // Every slot was filled or the function left.
        let regions = regions.map(|region| region.expect("filled above"));
        let parameters = Self { subject: file.subject, personal: file.personal, regions };
        if let Some(i) = parameters.tissue().gauges.iter().position(|gauge| !gauge.is_valid()) {
            let problem = "has values that single precision does not hold: check k_n_m3, c_n_s_m3 and the exponents";
            return Err(wrong(Region::ALL[i].name(), problem.into()));
        }
        Ok(parameters)
    }

    /// Writes a commented file.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        std::fs::write(path, self.to_toml()).map_err(|e| Error::Io(path.into(), e))
    }

    /// The commented file.
    pub fn to_toml(&self) -> String {
        let mut text = String::from(
            "# Plantar tissue parameters: one viscoelastic ellipsoid for each region of one foot.\n\
             # a_mm, b_mm, c_mm  radii: medial-lateral, heel-toe, vertical\n\
             # d0_mm             thickness of the unloaded tissue\n\
             # k_n_m3, n         stiffness k (d/d0)^n, N/m3\n\
             # c_n_s_m3, m       damping c (d/d0)^m, N s/m3\n\
             # Force alone does not tell a from b, nor c_mm and d0_mm from k and c: see docs/model.md.\n\n",
        );
        // Writing to a String does not fail.
        let _ = writeln!(text, "version = {VERSION}");
        let _ = writeln!(text, "subject = {:?}", self.subject);
        let note =
            if self.personal { "identified from this person's steps" } else { "NOT personal: typical values only" };
        let _ = writeln!(text, "personal = {} # {note}", self.personal);
        for (region, e) in Region::ALL.iter().zip(&self.regions) {
            let _ = write!(
                text,
                "\n[regions.{}]\na_mm = {:?}\nb_mm = {:?}\nc_mm = {:?}\nd0_mm = {:?}\nk_n_m3 = {:?}\nn = {:?}\nc_n_s_m3 = {:?}\nm = {:?}\n",
                region.name(),
                e.a_m * 1e3,
                e.b_m * 1e3,
                e.c_m * 1e3,
                e.d0_m * 1e3,
                e.k,
                e.n,
                e.c,
                e.m
            );
        }
        text
    }

    /// What a device evaluates, with an id made from the values.
    pub fn tissue(&self) -> Tissue {
        let gauges = self.regions.each_ref().map(|ellipsoid| {
            let g = ellipsoid.gauge();
            Gauge {
                ab_m2: g.ab_m2 as f32,
                c_m: g.c_m as f32,
                stiffness_pa: g.stiffness_pa as f32,
                damping_pa_s: g.damping_pa_s as f32,
                n: g.n as f32,
                m: g.m as f32,
            }
        });
        let mut bytes = Vec::new();
        for g in &gauges {
            for value in [g.ab_m2, g.c_m, g.stiffness_pa, g.damping_pa_s, g.n, g.m] {
                bytes.extend(value.to_le_bytes());
            }
        }
        // 0 stands for no parameters.
        Tissue { id: plantar::wire::checksum(&bytes).max(1), gauges }
    }
}

impl FileRegion {
    fn check(&self) -> Result<Ellipsoid<f64>, String> {
        let lengths = [("a_mm", self.a_mm), ("b_mm", self.b_mm), ("c_mm", self.c_mm), ("d0_mm", self.d0_mm)];
        for (name, value) in lengths {
            if !(0.1..=200.0).contains(&value) {
                return Err(format!(
                    "{name} = {value}: a length from 0.1 to 200 mm is needed, so that pi A B is positive"
                ));
            }
        }
        for (name, value) in [("k_n_m3", self.k_n_m3), ("c_n_s_m3", self.c_n_s_m3)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(format!("{name} = {value}: a finite value not below 0 is needed"));
            }
        }
        for (name, value) in [("n", self.n), ("m", self.m)] {
            if !(value > -1.0 && value <= 10.0) {
                return Err(format!("{name} = {value}: an exponent above -1 and up to 10 is needed"));
            }
        }
        let mm = 1e-3;
        Ok(Ellipsoid {
            a_m: self.a_mm * mm,
            b_m: self.b_mm * mm,
            c_m: self.c_mm * mm,
            d0_m: self.d0_mm * mm,
            k: self.k_n_m3,
            n: self.n,
            c: self.c_n_s_m3,
            m: self.m,
        })
    }
}
