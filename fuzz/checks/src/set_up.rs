//! An insole's set-up, its wearer's parameters, and frames with any codes: set-up or parameters are refused, or every result is
//! finite.

use crate::check_frame;
use emulation::read_setup;
use plantar::insole::Insole;
use plantar::num::Real;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::tissue::Tissue;
use std::io::Read;

/// Length of the encoded force laws of eight regions, six numbers of four bytes each.
const FORCE_LAWS_BYTES: usize = 8 * 6 * 4;

/// Checks one input.
pub fn check(data: &[u8]) {
    let Some((len, rest)) = data.split_first_chunk() else { return };
    let Some((setup, rest)) = rest.split_at_checked(u16::from_le_bytes(*len).into()) else { return };
    let Some((force_laws, frames)) = rest.split_first_chunk::<FORCE_LAWS_BYTES>() else { return };
    let Ok(force_laws) = postcard::from_bytes(force_laws) else { return };
    let tissue = Tissue::new(force_laws);
    walk::<f32>(setup, &tissue, frames);
    walk::<f64>(setup, &tissue, frames);
}

/// Passes the frames through an insole with this set-up, which computes in the precision `R`.
fn walk<R: Real>(setup: &[u8], tissue: &Tissue, frames: &[u8]) {
    let Some((config, cells)) = read_setup(|at, buffer| setup.get(at..).and_then(|mut rest| rest.read(buffer).ok()))
    else {
        return;
    };
    let mut insole = Box::new(Insole::<R, DEVICE_CELLS>::new());
    if insole.set_up(config.setup, cells).is_err() {
        assert!(insole.setup().is_none());
        return;
    }
    // After a refusal the insole has no parameters.
    let _ = insole.set_tissue(tissue);
    let mut seq = 0u32;
    // Each frame consists of the number of missing frames before it, and of one byte for each cell.
    for bytes in frames.chunks_exact(1 + insole.cells()) {
        seq = seq.wrapping_add(1).wrapping_add(bytes[0].into());
        let codes: Vec<_> = bytes[1..].iter().map(|&byte| u16::from_le_bytes([byte, byte])).collect();
        check_frame(&mut insole, seq, &codes);
    }
}
