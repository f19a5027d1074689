//! Computes the tables of docs/identification.md on the pressure from which a cell counts whole ([`ContactRule::full_kpa`]), as
//! Markdown: the predicted error by this pressure, and the bias of the area by the pitch of the sensor and the pressure.

use anyhow::Result;
use bench::studies::{self, mean_percent};
use clap::Parser;
use parameters::{InsoleSize, Parameters, TypicalRange};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::model::Ellipsoid;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::{Region, Side};
use recording::{Cell, Layout, MAX_CELLS, Recording, VirtualInsole};
use std::path::PathBuf;

/// Computes the predicted errors of ten walkers by the pressure from which a cell counts whole, and the bias of the area of
/// pressed ellipsoids.
#[derive(Parser)]
struct Arguments {
    /// The folder SpeedPP2DS of the Python package jiku-data.
    #[arg(long)]
    jiku: PathBuf,
}

/// The pressures from which a cell counts whole, kPa; 0 for counted cells.
const FULL_KPA: [f32; 7] = [0.0, 75.0, 100.0, 150.0, 200.0, 300.0, 600.0];
/// Distances between the centres of square cells, mm.
const PITCHES_MM: [f64; 4] = [5.0, 7.0, 10.0, 14.0];
/// Pressures at the centre of the contact, kPa.
const PRESSURES_KPA: [f64; 4] = [60.0, 120.0, 240.0, 480.0];
/// The regions of the tables of the bias: the heel, which is large, and the second toe, which is small.
const PRESSED: [Region; 2] = [Region::Heel, Region::Toe2];
/// In each direction, number of positions of the ellipsoid relative to the cells.
const POSITIONS: usize = 5;
/// In each direction, number of points over which the pressure of a cell is averaged.
const POINTS: usize = 12;

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    println!("| whole cell from | predicted error % | readings that count partly % |\n|---|---|---|");
    let walks = studies::walks(&arguments.jiku)?;
    for full_kpa in FULL_KPA {
        let rule = ContactRule { full_kpa, ..ContactRule::COUNTED };
        let studies = studies::fitted(&walks, rule)?;
        let predicted = (0..8).map(|region| mean_percent(&studies, region, |fit| fit.quality.predicted)).sum::<f64>();
        let whole_from =
            if full_kpa == 0.0 { "counted, 10 kPa".to_string() } else { format!("covered share, {full_kpa} kPa") };
        println!("| {whole_from} | {:.1} | {:.0} |", predicted / 8.0, partial_percent(&walks, &rule));
    }
    for region in PRESSED {
        let pressed = Pressed::of(region);
        println!(
            "\n{}, {:.0} mm2: bias of the area in % by pressure at the centre, first with counted cells, then with \
             covered shares:\n",
            region.name(),
            pressed.area_mm2()
        );
        let pressures = PRESSURES_KPA.map(|kpa| format!("{kpa:.0} kPa"));
        println!("| pitch | {} |\n|---|---|---|---|---|", pressures.join(" | "));
        for pitch_mm in PITCHES_MM {
            let mut cells = Vec::new();
            for peak_kpa in PRESSURES_KPA {
                let biases = [ContactRule::COUNTED, ContactRule::COVERED]
                    .map(|rule| pressed.bias_percent(pitch_mm, peak_kpa, rule));
                let [counted, covered] = biases;
                cells.push(format!("{:+.0}, {:+.0}", counted?, covered?));
            }
            println!("| {pitch_mm} mm | {} |", cells.join(" | "));
        }
    }
    Ok(())
}

/// The share of the readings in contact whose cells do not count whole, so that the area follows their pressure, %.
fn partial_percent(walks: &[Recording], rule: &ContactRule) -> f64 {
    let readings = || walks.iter().flat_map(|walk| &walk.pressure_kpa).filter(|kpa| **kpa >= rule.on_kpa);
    readings().filter(|kpa| **kpa < rule.full_kpa).count() as f64 / readings().count() as f64 * 100.0
}

/// A typical ellipsoid that is pressed onto a plate. The pressure is proportional to the local deformation (Eq. 3).
struct Pressed {
    region: Region,
    ellipsoid: Ellipsoid<f64>,
    deformation_m: f64,
    /// Radii of the contact, mm.
    r_mm: [f64; 2],
}

impl Pressed {
    /// The typical ellipsoid of a region, with a contact area in the middle of the typical range.
    fn of(region: Region) -> Self {
        let ellipsoid = Parameters::typical(InsoleSize::default()).regions[region as usize];
        let [least, most] = TypicalRange::of(InsoleSize::default())[region as usize].area_mm2;
        let ratio = ellipsoid.force_law().area_ratio((least + most) / 2.0 * 1e-6);
        let deformation_m = ellipsoid.c_m * ratio.normalised_deformation();
        let (r_a_m, r_b_m) = ellipsoid.contact_radii_m(deformation_m);
        Self { region, ellipsoid, deformation_m, r_mm: [r_a_m * 1e3, r_b_m * 1e3] }
    }

    /// Area of the contact ellipse, mm2.
    fn area_mm2(&self) -> f64 {
        std::f64::consts::PI * self.r_mm[0] * self.r_mm[1]
    }

    /// Relative pressure at a point, mm from the centre of the contact: 1 at the centre, 0 outside.
    fn pressure(&self, x_mm: f64, y_mm: f64) -> f64 {
        let q = (x_mm / self.r_mm[0]).hypot(y_mm / self.r_mm[1]);
        if q < 1.0 { self.ellipsoid.local_deformation_m(self.deformation_m, q) / self.deformation_m } else { 0.0 }
    }

    /// Mean over the positions of the area that an insole measures, relative to the area of the contact ellipse, minus 1, %.
    fn bias_percent(&self, pitch_mm: f64, peak_kpa: f64, rule: ContactRule) -> Result<f64> {
        // One further cell on each side, because the ellipsoid is shifted by up to half a cell.
        let side = (2.0 * self.r_mm[0].max(self.r_mm[1]) / pitch_mm).ceil() as usize + 2;
        let centre_mm = |i: usize| (i as f64 - (side as f64 - 1.0) / 2.0) * pitch_mm;
        let cell = |i: usize| Cell {
            x_mm: centre_mm(i % side),
            y_mm: centre_mm(i / side),
            area_mm2: pitch_mm * pitch_mm,
            region: self.region,
        };
        let within = |i: usize, count: usize| ((i as f64 + 0.5) / count as f64 - 0.5) * pitch_mm;
        let frame = |position: usize| {
            let shift_mm = [within(position % POSITIONS, POSITIONS), within(position / POSITIONS, POSITIONS)];
            (0..side * side).map(move |i| {
                let points = (0..POINTS * POINTS).map(|point| {
                    let x_mm = centre_mm(i % side) + within(point % POINTS, POINTS) - shift_mm[0];
                    let y_mm = centre_mm(i / side) + within(point / POINTS, POINTS) - shift_mm[1];
                    self.pressure(x_mm, y_mm)
                });
                (peak_kpa * points.sum::<f64>() / (POINTS * POINTS) as f64) as f32
            })
        };
        let positions = POSITIONS * POSITIONS;
        let recording = Recording {
            side: Side::Right,
            layout: Layout { name: String::new(), cells: (0..side * side).map(cell).collect(), sheet: None },
            rate_hz: 100.0,
            source: String::new(),
            t_s: (0..positions).map(|i| i as f64 * 0.01).collect(),
            pressure_kpa: (0..positions).flat_map(frame).collect(),
        };
        let insole = VirtualInsole::new(&recording, rule, StanceRule::ADAPTIVE);
        let mut codes = vec![0; recording.cells()];
        let mut areas_mm2 = 0.0;
        for i in 0..positions {
            // A new insole for each position, because a cell that was in contact remains so at a lower pressure.
            let mut device = Box::new(Insole::<f64, MAX_CELLS>::new());
            device.set_up(insole.setup, insole.cells.iter().copied())?;
            insole.codes_of(&recording, i, &mut codes);
            device.frame(0, &codes);
            areas_mm2 += device.loads()[self.region as usize].frame.area.area_mm2::<f64>();
        }
        Ok((areas_mm2 / positions as f64 / self.area_mm2() - 1.0) * 100.0)
    }
}
