//! The checks of each input of a fuzz target. A target is a module with the function `check`, which panics if a property does
//! not hold. `fuzz_targets` has the programs that call these functions with libFuzzer's inputs; the test `seeds` calls them
//! with the seeds in `corpus` and with variations of these.

pub mod client;
pub mod deframe;
pub mod fragments;
pub mod frames;
pub mod identify;
pub mod image;
pub mod jiku;
pub mod layout;
pub mod link;
pub mod management;
pub mod parameters;
pub mod pedar;
pub mod phone;
pub mod plateaus;
pub mod recording;
pub mod set_up;
pub mod stream;
pub mod table;
pub mod vendor;
pub mod wire;

use ::recording::{MAX_CELLS, MAX_KPA, Recording, VirtualInsole};
use plantar::insole::Insole;
use plantar::num::Real;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{Live, Step};
use std::panic::{set_hook, take_hook};

/// Splits an input into pieces, each preceded by its length in two bytes, little endian.
pub struct Pieces<'d>(pub &'d [u8]);

impl<'d> Iterator for Pieces<'d> {
    type Item = &'d [u8];

    fn next(&mut self) -> Option<&'d [u8]> {
        let (&len, rest) = self.0.split_first_chunk()?;
        let (piece, rest) = rest.split_at(rest.len().min(u16::from_le_bytes(len).into()));
        self.0 = rest;
        Some(piece)
    }
}

/// Lets panics in sources whose paths contain one of `names` unwind: the code under test catches them, and reports the file as
/// damaged. Any other panic still calls the hook that was set before: that of libFuzzer ends the process.
pub fn tolerate_panics_of(names: &'static [&'static str]) {
    let before = take_hook();
    set_hook(Box::new(move |panic| {
        if !panic.location().is_some_and(|place| names.iter().any(|name| place.file().contains(name))) {
            before(panic);
        }
    }));
}

/// Largest number of frames of a recording that a target replays: enough for a step, and few enough for many executions per
/// second.
const REPLAYED_FRAMES: usize = 128;

/// Checks that a recording is consistent after reading, and that an insole either refuses its layout or computes finite numbers
/// from its frames.
pub fn check_recording(recording: &Recording) {
    assert_eq!(recording.pressure_kpa.len(), recording.frames() * recording.cells());
    assert!((1..=MAX_CELLS).contains(&recording.cells()) && recording.frames() > 0);
    assert!(recording.rate_hz > 0.0 && recording.rate_hz.is_finite());
    assert!(recording.pressure_kpa.iter().all(|kpa| (0.0..=MAX_KPA).contains(kpa)));
    assert!(recording.t_s.iter().all(|t_s| t_s.is_finite()));
    let virtual_insole = VirtualInsole::new(recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    if insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).is_err() {
        return;
    }
    let mut codes = vec![0; virtual_insole.cells.len()];
    for i in 0..virtual_insole.frames(recording).min(REPLAYED_FRAMES) {
        virtual_insole.codes_of(recording, i, &mut codes);
        check_frame(&mut insole, i as u32, &codes);
    }
}

/// Passes one frame with any codes through an insole, and checks that every result is finite.
pub fn check_frame<R: Real, const N: usize>(insole: &mut Insole<R, N>, seq: u32, codes: &[u16]) {
    let is_step = insole.frame(seq, codes);
    for (region, load) in insole.loads().iter().enumerate() {
        let mut numbers =
            vec![load.frame.area.area_mm2(), load.frame.force.force_n, load.tissue.deformation_m, load.tissue.model_n];
        assert!(numbers.iter().all(|&v| v >= R::ZERO), "region {region}: {load:?}");
        if let Some(e) = insole.ellipse(region) {
            assert!(e.angle_deg().is_finite(), "region {region}: {e:?}");
            numbers.extend([e.x_mm, e.y_mm, e.r_a_mm, e.r_b_mm]);
        }
        numbers.extend(insole.centre_of_pressure_mm(region).into_iter().flat_map(|(x_mm, y_mm)| [x_mm, y_mm]));
        assert!(numbers.iter().all(|v| v.to_f64().is_finite()), "region {region}: {load:?} {numbers:?}");
    }
    Live::new(seq, 0, insole.loads(), insole.masked(), insole.foot_centre_mm());
    if !is_step {
        return;
    }
    let step = insole.whole_step().expect("a step is complete after toe off");
    Step::new(&step);
    for r in &step.regions {
        let numbers = [
            r.measured_peak_n,
            r.model_peak_n,
            r.measured_integral_n_s,
            r.model_integral_n_s,
            r.area_peak_mm2,
            r.counted_peak_mm2,
            r.deformation_peak_m,
            r.deformation_rate_peak_m_s,
            r.contact_s,
            r.time_to_peak_s,
            r.model_error,
        ];
        assert!(numbers.iter().all(|v| *v >= R::ZERO && v.to_f64().is_finite()), "{r:?}");
    }
}
