//! `plantar info`: a summary of a recording.

use anyhow::Result;
use clap::Args;
use plantar::Region;
use recording::Recording;
use std::path::PathBuf;

/// Prints a summary of a recording: source, foot, frame rate, duration, largest force and pressure, and the cells of each region.
#[derive(Args)]
pub struct Info {
    /// The recording.
    recording: PathBuf,
}

impl Info {
    pub fn run(&self) -> Result<()> {
        print(&Recording::read(&self.recording)?);
        Ok(())
    }
}

/// Prints a recording's summary.
pub fn print(recording: &Recording) {
    let seconds = recording.frames() as f64 / recording.rate_hz;
    let largest_n = (0..recording.frames()).map(|i| recording.force_n(i)).fold(0.0, f64::max);
    let largest_kpa = recording.pressure_kpa.iter().copied().fold(0.0, f32::max);
    println!("source    {}", recording.source);
    println!("foot      {}", recording.side.name());
    println!("frames    {} at {:.2} Hz, {seconds:.1} s", recording.frames(), recording.rate_hz);
    println!("largest   {largest_n:.0} N in total, {largest_kpa:.0} kPa on a cell");
    println!("layout    {}, {} cells", recording.layout.name, recording.cells());
    for region in Region::ALL {
        let areas: Vec<f64> =
            recording.layout.cells.iter().filter(|c| c.region == region).map(|c| c.area_mm2).collect();
        // The sum of no numbers is -0 in Rust.
        let sum_mm2 = areas.iter().sum::<f64>() + 0.0;
        println!("          {:<18} {:>4} cells {sum_mm2:>6.0} mm2", region.name(), areas.len());
    }
}
