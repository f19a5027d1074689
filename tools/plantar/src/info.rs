//! `plantar info`: a summary of a recording.

use crate::replay::progress;
use anyhow::Result;
use clap::Args;
use plantar::Region;
use recording::{Clipping, Recording, RecordingReader};
use std::path::PathBuf;

/// Prints a summary of a recording: source, foot, frame rate, duration, largest force and pressure, and the cells of each region.
#[derive(Args)]
pub struct Info {
    /// The recording.
    recording: PathBuf,
}

impl Info {
    pub fn run(&self) -> Result<()> {
        let reader = RecordingReader::open(&self.recording)?;
        let mut loads = Loads::new(reader.largest_kpa()?);
        let bar = progress(reader.frames() as u64, "frames");
        reader.for_each_frame(|kpa| {
            loads.add(&reader.head, kpa);
            if loads.frames.is_multiple_of(4096) {
                bar.set_position(loads.frames as u64);
            }
        })?;
        bar.finish_and_clear();
        loads.print(&reader.head);
        // `plantar import`, which also prints a summary, has this warning among others.
        if let Some(warning) = loads.clipping.warning() {
            eprintln!("warning: {warning}");
        }
        Ok(())
    }
}

/// Prints the summary of a recording in memory.
pub fn print(recording: &Recording) {
    let mut loads = Loads::new(recording.largest_kpa());
    (0..recording.frames()).for_each(|i| loads.add(recording, recording.frame(i)));
    loads.print(recording);
}

/// The number of frames of a recording, and its largest loads.
struct Loads {
    frames: usize,
    largest_n: f64,
    clipping: Clipping,
}

impl Loads {
    /// Before the first frame of a recording with this largest pressure, kPa.
    fn new(largest_kpa: f32) -> Self {
        Self { frames: 0, largest_n: 0.0, clipping: Clipping::new(largest_kpa) }
    }

    /// Adds a frame with these pressures, kPa. `head` describes the recording.
    fn add(&mut self, head: &Recording, kpa: &[f32]) {
        self.frames += 1;
        self.largest_n = self.largest_n.max(head.layout.force_n(kpa));
        self.clipping.add(kpa);
    }

    fn print(&self, recording: &Recording) {
        let Self { frames, largest_n, clipping } = self;
        let seconds = *frames as f64 / recording.rate_hz;
        println!("source    {}", recording.source);
        println!("foot      {}", recording.side.name());
        println!("frames    {frames} at {:.2} Hz, {seconds:.1} s", recording.rate_hz);
        println!("largest   {largest_n:.0} N in total, {:.0} kPa on a cell", clipping.largest_kpa());
        // The name of some layouts ends with the number of their cells.
        let cells = format!(", {} cells", recording.cells());
        println!("layout    {}{cells}", recording.layout.name.trim_end_matches(&cells));
        for region in Region::ALL {
            let areas: Vec<f64> =
                recording.layout.cells.iter().filter(|c| c.region == region).map(|c| c.area_mm2).collect();
            // The sum of no numbers is -0 in Rust.
            let sum_mm2 = areas.iter().sum::<f64>() + 0.0;
            println!("          {:<18} {:>4} cells {sum_mm2:>6.0} mm2", region.name(), areas.len());
        }
    }
}
