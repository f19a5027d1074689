//! OpenSim's external loads, as a .mot or .sto file: force, point of application and torque of each foot.
//!
//! The axes are those of OpenSim's models, x forwards, y upwards and z to the right, but fixed to the insole, because an insole
//! does not know where it is in the laboratory. The origin is at the back of the heel on the medial edge. An insole measures
//! normal force only.

use crate::{Foot, Session};
use plantar::Side;
use recording::{Result, output};
use std::io::{self, Write};
use std::path::Path;

/// Writes the external loads: time in s, force in N, point of application in m, torque in N m. Force, point and torque are 0
/// while the foot is off the ground.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn write(session: &Session, path: &Path) -> Result<()> {
    output::file(path, |to| {
        let columns: Vec<String> = session.feet.iter().flat_map(columns).collect();
        writeln!(to, "plantar\nversion=1\nnRows={}\nnColumns={}", session.frames(), 1 + columns.len())?;
        writeln!(to, "inDegrees=no\nendheader\ntime\t{}", columns.join("\t"))?;
        for (i, t_s) in session.t_s.iter().enumerate() {
            write!(to, "{t_s}")?;
            for foot in &session.feet {
                write_load(foot, i, to)?;
            }
            writeln!(to)?;
        }
        Ok(())
    })
}

/// The names of the columns of a foot.
fn columns(foot: &Foot) -> Vec<String> {
    let side = if foot.side == Side::Left { 'l' } else { 'r' };
    let axes = |name: &str| ["x", "y", "z"].map(|axis| format!("ground_{name}{axis}"));
    [axes(&format!("force_{side}_v")), axes(&format!("force_{side}_p")), axes(&format!("torque_{side}_"))].concat()
}

/// Writes the force, point and torque of a foot in frame `i`.
fn write_load(foot: &Foot, i: usize, to: &mut impl Write) -> io::Result<()> {
    let frame = &foot.frames[i];
    let (force_n, [x_m, z_m]) = frame.cop_mm.map_or((0.0, [0.0; 2]), |(lateral_mm, forward_mm)| {
        // The lateral side of the left foot is on the left.
        let right_mm = if foot.side == Side::Left { -lateral_mm } else { lateral_mm };
        (frame.total_force_n(), [forward_mm, right_mm].map(|mm| mm / 1e3))
    });
    write!(to, "\t0\t{force_n}\t0\t{x_m}\t0\t{z_m}\t0\t0\t0")
}
