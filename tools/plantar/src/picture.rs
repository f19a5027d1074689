//! A step as a picture: peak pressure with the contact ellipses on the foot, force of every region over time.

use crate::setup::rule_in_words;
use anyhow::{Context, Result, anyhow};
use plantar::insole::Insole;
use plantar::protocol::Step;
use plantar::{Real, Region, Side};
use plotters::coord::Shift;
use plotters::prelude::*;
use recording::{Recording, VirtualInsole};
use std::path::Path;

/// Colours of the regions, heel to toes, as the paper's Fig. 1 names them.
const COLOURS: [RGBColor; 8] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 39, 40),
    RGBColor(44, 160, 44),
    RGBColor(148, 103, 189),
    RGBColor(23, 160, 170),
    RGBColor(227, 119, 194),
    RGBColor(255, 127, 14),
    RGBColor(127, 127, 127),
];
const SIZE: (u32, u32) = (1100, 640);
const FOOT_WIDTH: u32 = 330;

/// Collects the live forces of a replay.
#[derive(Default)]
pub struct Drawing {
    /// Per frame and region: measured and model force, N.
    forces: Vec<[(f64, f64); 8]>,
}

impl Drawing {
    /// Takes the insole's last frame.
    pub fn push<R: Real, const N: usize>(&mut self, insole: &Insole<R, N>) {
        let forces = |load: &plantar::pipeline::live::RegionLoad<R>| {
            (load.frame.force.force_n.to_f64(), load.tissue.model_n.to_f64())
        };
        self.forces.push(insole.loads().each_ref().map(forces));
    }

    /// Draws one step of the recording to an SVG file.
    pub fn draw(&self, path: &Path, recording: &Recording, worn: &VirtualInsole, step: Option<&Step>) -> Result<()> {
        let step = step.context("no step to draw: the recording holds none")?;
        let frame = |us: u64| ((us as f64 * 1e-6 * recording.rate_hz).round() as usize).min(recording.frames());
        let frames = frame(step.start_us)..frame(step.start_us + u64::from(step.duration_us));
        let area = SVGBackend::new(path, SIZE).into_drawing_area();
        let drawn = area.fill(&WHITE).map_err(drawing_error).and_then(|()| {
            let (foot, curves) = area.split_horizontally(FOOT_WIDTH);
            draw_foot(&foot, recording, worn, step, frames.clone())?;
            for (i, panel) in curves.split_evenly((3, 3)).iter().take(8).enumerate() {
                self.draw_region(panel, i, recording.rate_hz, frames.clone())?;
            }
            area.present().map_err(drawing_error)
        });
        drawn.with_context(|| format!("cannot write {}", path.display()))
    }

    fn draw_region(
        &self,
        panel: &DrawingArea<SVGBackend, Shift>,
        region: usize,
        rate_hz: f64,
        frames: std::ops::Range<usize>,
    ) -> Result<()> {
        let forces = self.forces.get(frames).context("the step lies outside of the recording")?;
        let curve = |pick: fn((f64, f64)) -> f64| {
            forces.iter().enumerate().map(move |(i, f)| (i as f64 / rate_hz, pick(f[region])))
        };
        let top_n = curve(|f| f.0.max(f.1)).fold(10.0, |top: f64, (_, n)| top.max(n)) * 1.1;
        let seconds = forces.len() as f64 / rate_hz;
        let mut chart = ChartBuilder::on(panel)
            .caption(Region::ALL[region].name().replace('_', " "), ("sans-serif", 15))
            .margin(6)
            .x_label_area_size(24)
            .y_label_area_size(46)
            .build_cartesian_2d(0.0..seconds, 0.0..top_n)
            .map_err(drawing_error)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_labels(4)
            .y_labels(4)
            .x_desc("s")
            .y_label_formatter(&|n| format!("{n:.0} N"))
            .label_style(("sans-serif", 11))
            .draw()
            .map_err(drawing_error)?;
        chart.draw_series(LineSeries::new(curve(|f| f.0), BLACK.stroke_width(2))).map_err(drawing_error)?;
        chart.draw_series(LineSeries::new(curve(|f| f.1), COLOURS[region].stroke_width(2))).map_err(drawing_error)?;
        Ok(())
    }
}

/// The sole from above, toes up; the left foot's lateral side is on the left.
fn draw_foot(
    area: &DrawingArea<SVGBackend, Shift>,
    recording: &Recording,
    worn: &VirtualInsole,
    step: &Step,
    frames: std::ops::Range<usize>,
) -> Result<()> {
    let cells = &recording.layout.cells;
    let mut peak_kpa = vec![0.0f32; cells.len()];
    for i in frames {
        for (peak, kpa) in peak_kpa.iter_mut().zip(worn.measured_kpa(recording.frame(i))) {
            *peak = peak.max(kpa);
        }
    }
    let largest_kpa = peak_kpa.iter().copied().fold(1.0, f32::max);
    let extent = |pick: fn(&recording::Cell) -> f64| {
        let (low, high) = cells.iter().map(pick).fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        (low - 8.0, high + 8.0)
    };
    let (x, y) = (extent(|c| c.x_mm), extent(|c| c.y_mm));
    let mirror = if recording.side == Side::Left { -1.0 } else { 1.0 };
    let (width_px, height_px) = area.dim_in_pixel();
    let scale = (f64::from(height_px - 60) / (y.1 - y.0)).min(f64::from(width_px - 20) / (x.1 - x.0));
    let middle = (x.0 + x.1) / 2.0;
    let at = |x_mm: f64, y_mm: f64| {
        let x_px = f64::from(width_px) / 2.0 + mirror * (x_mm - middle) * scale;
        let y_px = f64::from(height_px) - 20.0 - (y_mm - y.0) * scale;
        (x_px.round() as i32, y_px.round() as i32)
    };
    area.draw(&Text::new("peak pressure, ellipse at peak force", (12, 10), ("sans-serif", 15)))
        .map_err(drawing_error)?;
    for (cell, &kpa) in cells.iter().zip(&peak_kpa) {
        let half = cell.area_mm2.sqrt() / 2.0;
        let corners = [at(cell.x_mm - half, cell.y_mm - half), at(cell.x_mm + half, cell.y_mm + half)];
        let shade = (kpa / largest_kpa).sqrt();
        let light = |full: u8| (255.0 - f32::from(255 - full) * (0.06 + 0.94 * shade)) as u8;
        let RGBColor(r, g, b) = COLOURS[cell.region as usize];
        let colour = RGBColor(light(r), light(g), light(b));
        area.draw(&Rectangle::new(corners, colour.filled())).map_err(drawing_error)?;
    }
    for r in step.regions.iter().filter(|r| r.ellipse_r_a_cmm > 0) {
        let (centre_x, centre_y) = (f64::from(r.ellipse_x_dmm) / 10.0, f64::from(r.ellipse_y_dmm) / 10.0);
        let (r_a, r_b) = (f64::from(r.ellipse_r_a_cmm) / 100.0, f64::from(r.ellipse_r_b_cmm) / 100.0);
        let (sin, cos) = (f64::from(r.ellipse_angle_ddeg) / 10.0).to_radians().sin_cos();
        let rim = (0..=72).map(|i| {
            let (v, u) = (f64::from(i) * 5.0).to_radians().sin_cos();
            at(centre_x + r_a * u * cos - r_b * v * sin, centre_y + r_a * u * sin + r_b * v * cos)
        });
        area.draw(&PathElement::new(rim.collect::<Vec<_>>(), BLACK.stroke_width(2))).map_err(drawing_error)?;
    }
    let legend = format!("black: measured, colour: model; contact: {}", rule_in_words(&step.contact_rule));
    area.draw(&Text::new(legend, (12, 30), ("sans-serif", 13))).map_err(drawing_error)?;
    Ok(())
}

fn drawing_error(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("{error}")
}
